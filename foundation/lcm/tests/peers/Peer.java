import java.io.BufferedInputStream;
import java.io.DataInputStream;
import java.io.DataOutputStream;
import java.io.EOFException;
import java.io.FileDescriptor;
import java.io.FileOutputStream;
import java.io.IOException;
import java.lang.reflect.Array;
import java.lang.reflect.Field;
import java.lang.reflect.Modifier;
import java.nio.charset.StandardCharsets;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.Arrays;
import java.util.concurrent.Semaphore;
import java.util.concurrent.TimeUnit;
import lcm.lcm.LCM;
import lcm.lcm.LCMDataInputStream;
import lcm.lcm.LCMDataOutputStream;
import lcm.lcm.LCMEncodable;
import lcm.lcm.MessageAggregator;
import lcm.logging.Log;

/**
 * A peer on the official Java library; what it does stands in peer.c.
 *
 * <p>Types are named `vec.geom.point_t`, their channels `vec_geom_point_t`; those without a package are in `lcmtypes`.
 * One more role, `types TYPE...`: makes one of each, encodes and decodes it.
 */
final class Peer {
    private static final String PROBE = "PEER_PROBE";

    private final DataOutputStream out;
    private final LCM lcm = new LCM();

    private Peer(DataOutputStream out) throws IOException {
        this.out = out;
    }

    private static Class<? extends LCMEncodable> find(String name) throws ClassNotFoundException {
        return Class.forName(name.contains(".") ? name : "lcmtypes." + name).asSubclass(LCMEncodable.class);
    }

    private static byte[] again(Class<? extends LCMEncodable> type, byte[] data) throws ReflectiveOperationException {
        return encoded(type.getConstructor(byte[].class).newInstance((Object) data));
    }

    private static byte[] encoded(LCMEncodable message) {
        try {
            LCMDataOutputStream bytes = new LCMDataOutputStream();
            message.encode(bytes);
            return bytes.toByteArray();
        } catch (IOException error) {
            throw new IllegalStateException(error);
        }
    }

    /** One of this type, with empty strings and arrays in place of null. */
    private static Object made(Class<?> type) throws ReflectiveOperationException {
        if (type == String.class)
            return "";
        if (type.isArray())
            return Array.newInstance(type.getComponentType(), 0);
        if (type.getPackageName().equals("java.lang"))
            return null;
        Object message;
        try {
            message = type.getConstructor().newInstance();
        } catch (NoSuchMethodException error) { // an enum
            return type.getConstructor(int.class).newInstance(0);
        }
        for (Field field : type.getFields()) {
            if (Modifier.isStatic(field.getModifiers()) || field.getType().isPrimitive())
                continue;
            if (field.get(message) == null)
                field.set(message, made(field.getType()));
            else
                fill(field.get(message));
        }
        return message;
    }

    /** Makes the elements of an array of fixed size. */
    private static void fill(Object array) throws ReflectiveOperationException {
        Class<?> element = array.getClass().getComponentType();
        for (int n = 0; !element.isPrimitive() && n < Array.getLength(array); n++) {
            if (element.isArray())
                fill(Array.get(array, n));
            else
                Array.set(array, n, made(element));
        }
    }

    private static void copyLog(String source, String target) throws IOException {
        Files.deleteIfExists(Path.of(target)); // an existing one is not truncated
        Log from = new Log(source, "r"), to = new Log(target, "rw");
        try {
            while (true)
                to.write(from.readNext());
        } catch (EOFException end) {
            to.close();
        }
    }

    private void bus(String... types) throws Exception {
        // TCPQ connects in a thread of the library, which a subscription at that moment may end.
        Semaphore heard = new Semaphore(0);
        lcm.subscribe(PROBE, (bus, channel, in) -> heard.release());
        probe(heard);
        // As a program of MATLAB receives.
        MessageAggregator received = new MessageAggregator();
        lcm.subscribe("TO_.*", received);
        Thread teller = new Thread(() -> {
            while (true) {
                MessageAggregator.Message message = received.getNextMessage();
                tell(message.channel, message.data);
            }
        });
        teller.setDaemon(true);
        teller.start();
        for (String name : types) {
            Class<? extends LCMEncodable> type = find(name);
            lcm.subscribe(name.replace('.', '_'), (bus, channel, in) -> {
                try {
                    byte[] payload = again(type, payload(in));
                    tell(channel, payload);
                    bus.publish("FROM_TYPED", payload, 0, payload.length);
                } catch (IOException | ReflectiveOperationException error) {
                    fail(error);
                }
            });
        }
        probe(heard);
        out.writeBytes("ready\n");
        DataInputStream in = new DataInputStream(new BufferedInputStream(System.in));
        while (publish(in))
            continue;
    }

    /** Publishes to itself until it hears it: everything before is subscribed to then. */
    private void probe(Semaphore heard) throws Exception {
        heard.drainPermits();
        do {
            lcm.publish(PROBE, new byte[0], 0, 0);
        } while (!heard.tryAcquire(20, TimeUnit.MILLISECONDS));
    }

    private static byte[] payload(LCMDataInputStream in) {
        byte[] payload = new byte[in.available()];
        try {
            in.readFully(payload);
        } catch (IOException error) {
            fail(error);
        }
        return payload;
    }

    private synchronized void tell(String channel, byte[] payload) {
        byte[] bytes = channel.getBytes(StandardCharsets.UTF_8);
        try {
            out.writeInt(bytes.length);
            out.writeInt(payload.length);
            out.write(bytes);
            out.write(payload);
        } catch (IOException error) {
            fail(error);
        }
    }

    /** Publishes the next message of stdin; false at its end. */
    private boolean publish(DataInputStream in) throws IOException {
        int channelLength;
        try {
            channelLength = in.readInt();
        } catch (EOFException end) {
            return false;
        }
        byte[] channel = new byte[channelLength], payload = new byte[in.readInt()];
        in.readFully(channel);
        in.readFully(payload);
        lcm.publish(new String(channel, StandardCharsets.UTF_8), payload, 0, payload.length);
        return true;
    }

    private static void fail(Throwable error) {
        error.printStackTrace();
        Runtime.getRuntime().halt(1);
    }

    public static void main(String[] args) throws Exception {
        // The library prints to standard output, too.
        DataOutputStream out = new DataOutputStream(new FileOutputStream(FileDescriptor.out));
        System.setOut(System.err);
        Thread.setDefaultUncaughtExceptionHandler((thread, error) -> fail(error));
        String[] rest = Arrays.copyOfRange(args, 1, args.length);
        if (args[0].equals("log")) {
            copyLog(rest[0], rest[1]);
        } else if (args[0].equals("types")) {
            for (String name : rest)
                again(find(name), encoded((LCMEncodable) made(find(name))));
        } else {
            new Peer(out).bus(rest);
        }
        System.exit(0);
    }
}
