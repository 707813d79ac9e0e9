package advee;

import common.cmd_level_t;
import common.cmd_state_t;
import common.data_faults_t;
import common.data_state_t;
import common.error_t;
import common.fault_t;
import java.io.IOException;
import java.nio.channels.SelectableChannel;
import java.nio.channels.SelectionKey;
import java.nio.channels.Selector;
import java.nio.charset.StandardCharsets;
import java.time.Instant;
import java.time.temporal.ChronoUnit;
import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Comparator;
import java.util.Iterator;
import java.util.List;
import java.util.Map;
import java.util.Map.Entry;
import java.util.TreeMap;
import java.util.concurrent.Callable;
import java.util.concurrent.CountDownLatch;
import java.util.concurrent.TimeUnit;
import lcm.lcm.LCM;
import lcm.lcm.LCMDataInputStream;
import lcm.lcm.LCMEncodable;

/**
 * The contract of a module, for modules in Java 11 on the official LCM (docs/writing-a-module.md).
 *
 * <pre>
 * final class Watch extends Module {
 *     Watch(Arguments arguments) {
 *         super(arguments);
 *         subscribe("LL_DATA_POWER", data_power_t::new, power -&gt; working());
 *     }
 *
 *     public static void main(String[] args) {
 *         var arguments = new Arguments("watch", "Waits for the power controller.", args);
 *         arguments.end();
 *         run(() -&gt; new Watch(arguments));
 *     }
 * }
 * </pre>
 *
 * One loop serves the bus, timers and the module's own channels, and sends heartbeats; all handlers are called from it
 * and must return quickly: one that takes 200 ms is a hang. Around them the loop announces the state each second and on
 * change, obeys state commands by the table, reports each fault when it is raised and when it is cleared, lists the
 * active ones, and ends at TERMINATE, at SIGTERM, and when the watchdog that started it is gone without a successor.
 * Needs lcm.jar and the output of the official lcm-gen for messages/*.lcm. advee.py: the same in Python.
 *
 * <p>The code of lcm-gen keeps one byte of a string in each char: {@link #wire} and {@link #text} convert what is not
 * ASCII. `import advee.Module` is needed by its name, because java.lang has a class Module, too.
 */
public abstract class Module {
    private static final double ANNOUNCE = 1.0; // s between two announcements
    private static final double LOOK = 0.5;     // s between two checks for the watchdog
    private static final int ORPHANED = 6;      // checks without CM_DATA_PROCESSES: it is gone, without a successor
    private static final int FAULTS_MAX = 256;  // active faults in a list; further ones are not reported
    private static final int TEXT_MAX = 512;    // bytes of a subject or a message in a list
    private static final int BURST = 64; // maximum messages per cycle of the loop, and waiting ones of a channel
    private static final int LEVEL_DEBUG = 0, LEVEL_ERROR = 3; // a severity is of the level above its value
    private static final long REFUSALS = 1_000_000_000; // ns at least between two reports of refused levels
    private static final long MS = 1_000_000; // ns
    /** Methods between the place of a fault and the stack that report() sees. */
    private static final List<String> RAISING = List.of("report", "forbidden", "fault", "clear", "fatal");

    /** Exit codes: a class plus a number 0 to 16. */
    public static final int RESOURCE = 0x10, DEVICE = 0x20, OTHER = 0x40;
    /** Fault numbers shared by all modules (docs/faults.md). A module's own numbers begin at 0x8001. */
    public static final int COMMAND_FORBIDDEN = 0x0001, MESSAGE_MALFORMED = 0x0002, UNHANDLED = 0x8000;

    private static final long EPOCH_NS = ChronoUnit.NANOS.between(Instant.EPOCH, Instant.now()) - System.nanoTime();

    /** The states of a module, in the order of their values on the wire. */
    public enum State { UNKNOWN, INIT, STOP, RUN, ERROR, TERMINATE, PAUSE }

    /** Types of a fault, in the order of their values on the wire. */
    public enum Kind { UNKNOWN, TIMEOUT, RESOURCE, DEVICE }

    /** Severities: information, irregularity, work that is not being done. */
    public enum Severity { NOTICE, WARNING, ERROR }

    /** A handler of messages. */
    public interface Handler<T> {
        void handle(T message) throws Exception;
    }

    /** A handler of a timer, of a channel, or of what a thread has posted. */
    public interface Action {
        void run() throws Exception;
    }

    /** Makes a message of its bytes: the constructor of its type. */
    public interface Decoder<T> {
        T decode(byte[] data) throws IOException;
    }

    /** A timer. */
    private static final class Timer {
        private final long period;
        private final Action handler;
        private long due;

        private Timer(long period, Action handler) {
            this.period = period;
            this.handler = handler;
            due = System.nanoTime() + period;
        }
    }

    /** An active fault: as it was last raised, and the time when it was first raised. */
    private static final class Active {
        private final Kind kind;
        private final long since;
        private final boolean sent; // its begin was reported, so its end will be
        private Severity severity;
        private String message;

        private Active(Kind kind, Severity severity, long since, String message, boolean sent) {
            this.sent = sent;
            this.kind = kind;
            this.severity = severity;
            this.since = since;
            this.message = message;
        }
    }

    /** Hands over what other threads have for the loop. */
    private final class Inbox {
        private final ArrayDeque<Entry<Object, Action>> waiting = new ArrayDeque<>();

        /** Puts it in; of more than BURST from one source the oldest is dropped. */
        private synchronized void put(Object source, Action action) {
            if (waiting.size() >= BURST && waiting.stream().filter(it -> it.getKey() == source).count() >= BURST) {
                Iterator<Entry<Object, Action>> oldest = waiting.iterator();
                while (oldest.next().getKey() != source) {
                    continue;
                }
                oldest.remove();
            }
            waiting.add(Map.entry(source, action));
            selector.wakeup();
        }

        /** The next one, or null. */
        private synchronized Action take() {
            return waiting.isEmpty() ? null : waiting.remove().getValue();
        }

        private synchronized boolean isEmpty() {
            return waiting.isEmpty();
        }
    }

    /** Its name on the bus. */
    protected final String name;
    /** For the module's own threads; the loop's heartbeat is sent by run(). */
    protected final Beats beats = new Beats(System.getenv("ADVEE_BEATS"));

    private final LCM bus;
    private final Selector selector;
    private final Inbox inbox = new Inbox();
    private final List<Timer> timers = new ArrayList<>();
    private final Map<Entry<Integer, String>, Active> faults = new TreeMap<>(
            Entry.<Integer, String>comparingByKey().thenComparing(Entry.comparingByValue(Comparator.naturalOrder())));
    private volatile State state = State.INIT;
    private State beforeError = State.INIT, wanted;
    private boolean lost;  // last report of the module about its device
    private int sendFrom = LEVEL_DEBUG; // level from which reports are sent
    private int refused;   // commands for the levels since the last report of one
    private long refusal = System.nanoTime() - REFUSALS; // time of that report
    private int unheard;   // checks since the last message of the watchdog
    private int code = -1; // 0 or above: the module ends with this code

    @SuppressWarnings("this-escape") // nothing is called before run()
    protected Module(Arguments arguments) {
        name = arguments.name;
        wanted = arguments.state;
        try {
            // The library itself only prints a note about an unknown protocol, and is deaf and dumb.
            if (!arguments.lcmUrl.matches("(udpm|tcpq|memq|file)://.*"))
                throw new IOException("unknown protocol");
            bus = new LCM(arguments.lcmUrl);
            selector = Selector.open();
            if (arguments.lcmUrl.startsWith("tcpq:"))
                awaitHub();
        } catch (IOException | InterruptedException | RuntimeException error) {
            throw arguments.refuse("LCM at " + arguments.lcmUrl + ": " + said(error));
        }
        subscribe("CM_CMD_STATE", cmd_state_t::new, this::obey);
        subscribe("CM_CMD_LEVEL", cmd_level_t::new, this::setLevel);
        if (System.getenv("ADVEE_GUARDED") != null) { // a watchdog has started us
            receive("CM_DATA_PROCESSES", data -> unheard = 0);
            every(LOOK, this::lookForWatchdog);
        }
    }

    /** Creates the module, runs it, and ends the process with its exit code. */
    public static void run(Callable<? extends Module> module) {
        int code = OTHER;
        try {
            code = module.call().run();
        } catch (Exception | Error error) { // of its constructor: it has not announced itself yet
            error.printStackTrace();
        }
        System.exit(code);
    }

    // --- for the module ---

    /** To be overridden: called after a change of state has been announced. In TERMINATE it is the last call. */
    protected void onState(State state) {
    }

    /** Its state, for any thread. */
    public final State state() {
        return state;
    }

    /** True if the module may act: only in RUN. */
    public final boolean acts() {
        return state == State.RUN;
    }

    /** Calls the handler for each message. A message of another type is dropped and reported once. */
    protected final <T> void subscribe(String channel, Decoder<T> decoder, Handler<? super T> handler) {
        receive(channel, data -> {
            T message;
            try {
                message = decoder.decode(data);
            } catch (IOException | RuntimeException | OutOfMemoryError | StackOverflowError error) { // invalid counts
                fault(MESSAGE_MALFORMED, Kind.UNKNOWN, Severity.WARNING,
                        channel + ": a message of " + data.length + " bytes is dropped: " + said(error), channel);
                return;
            }
            handler.handle(message);
        });
    }

    /** Publishes a message of a type generated by lcm-gen, none of whose fields may be null. For any thread. */
    protected final void publish(String channel, LCMEncodable message) {
        bus.publish(channel, message);
    }

    /** Calls the handler with this period; missed calls are dropped. */
    protected final void every(double seconds, Action handler) {
        timers.add(new Timer(Math.max(1, Math.round(1e9 * seconds)), handler));
    }

    /** Calls the handler when this channel (a socket, a pipe) is ready: SelectionKey.OP_READ and others. */
    protected final void watch(SelectableChannel channel, int operations, Action handler) throws IOException {
        channel.configureBlocking(false);
        channel.register(selector, operations, handler);
    }

    /** Lets the loop call the handler, for threads that wait for other things; of more than 64 the oldest is lost. */
    protected final void post(Action handler) {
        inbox.put(Action.class, handler);
    }

    /** Reports the device as present: leads out of INIT, and out of ERROR to the previous state. May be repeated. */
    protected final void working() {
        lost = false;
        if (state == State.ERROR && beforeError != State.INIT)
            enter(beforeError);
        else if (state == State.INIT || state == State.ERROR)
            enter(wanted);
    }

    /** Reports the device as lost: ERROR, until working(). Keep trying. May be repeated. */
    protected final void failed() {
        lost = true;
        if (state == State.ERROR || state == State.TERMINATE)
            return;
        beforeError = state;
        enter(State.ERROR);
    }

    /** Raises a fault without a subject. */
    protected final void fault(int number, Kind kind, Severity severity, String text) {
        fault(number, kind, severity, text, "");
    }

    /**
     * Raises a fault; reported once until clear(). The meaning of its number, 0x8001 or above, never changes; `subject`
     * distinguishes faults of one number. Raised again, it is listed with the new severity and text.
     */
    protected final void fault(int number, Kind kind, Severity severity, String text, String subject) {
        Active active = faults.get(Map.entry(number, subject));
        if (active != null) {
            boolean news = active.severity != severity;
            active.severity = severity;
            active.message = text;
            if (news)
                list(timestamp());
        } else if (faults.size() < FAULTS_MAX) {
            long since = timestamp();
            boolean sent = sends(severity);
            faults.put(Map.entry(number, subject), new Active(kind, severity, since, text, sent));
            list(since);
            if (sent)
                report(number, kind, severity, text, since, false);
        }
    }

    /** Clears a fault without a subject. */
    protected final void clear(int number, String text) {
        clear(number, text, "");
    }

    /** Clears a fault; reported if it was active. */
    protected final void clear(int number, String text, String subject) {
        Active active = faults.remove(Map.entry(number, subject));
        if (active == null)
            return;
        long now = timestamp();
        list(now);
        if (active.sent)
            report(number, active.kind, Severity.NOTICE, text, now, false);
    }

    /** Reports a fatal error, and ends with the exit code of its kind. The watchdog restarts the module. */
    protected final void fatal(int number, Kind kind, String text) {
        fatal(number, kind, text, kind == Kind.RESOURCE ? RESOURCE : kind == Kind.DEVICE ? DEVICE : OTHER);
    }

    /** Reports a fatal error, and ends with this exit code. The watchdog restarts the module. */
    protected final void fatal(int number, Kind kind, String text, int exit) {
        report(number, kind, Severity.ERROR, text, timestamp(), true);
        code = exit;
    }

    /** Ends the module in good order, as a TERMINATE command does. */
    protected final void end() {
        if (state == State.TERMINATE)
            return;
        enter(State.TERMINATE);
        if (code < 0)
            code = 0;
    }

    /** Current time for messages, µs since 1970; a step of the wall clock never turns it back. */
    public static long timestamp() {
        return (EPOCH_NS + System.nanoTime()) / 1000;
    }

    /** A text as a field of a message: in each char a byte of its UTF-8. */
    public static String wire(String text) {
        return new String(text.getBytes(StandardCharsets.UTF_8), StandardCharsets.ISO_8859_1);
    }

    /** The text of a field of a message. */
    public static String text(String wire) {
        return new String(wire.getBytes(StandardCharsets.ISO_8859_1), StandardCharsets.UTF_8);
    }

    // --- the loop ---

    /** Runs until the module ends, and returns the exit code. */
    public final int run() {
        CountDownLatch ended = new CountDownLatch(1);
        Runtime.getRuntime().addShutdownHook(new Thread(() -> onSignal(ended)));
        // The thread of the library that receives must not end unnoticed.
        Thread.setDefaultUncaughtExceptionHandler((thread, error) -> inbox.put(thread, () -> broken(error)));
        try {
            announceAll();
            every(ANNOUNCE, this::announceAll);
            Beats.Beat beat = beats.thread("main");
            while (code < 0) {
                beat.run();
                serveTimers();
                if (code < 0)
                    await(beat);
                serveChannels();
                serveInbox();
            }
        } catch (Exception | Error error) {
            broken(error);
        } finally {
            ended.countDown();
        }
        return code;
    }

    /** At SIGTERM and SIGINT: the loop ends, and its exit code is that of the process, in place of the signal's. */
    private void onSignal(CountDownLatch ended) {
        if (ended.getCount() == 0) // it has ended by itself
            return;
        inbox.put(ended, this::end);
        try {
            ended.await();
        } catch (InterruptedException error) {
            return;
        }
        Runtime.getRuntime().halt(code);
    }

    /** TCPQ connects in a thread of the library: what is published meanwhile is lost. */
    private void awaitHub() throws IOException, InterruptedException {
        byte[] test = "lcm self test".getBytes(StandardCharsets.US_ASCII);
        CountDownLatch heard = new CountDownLatch(1);
        bus.subscribe("LCM_SELF_TEST", (lcm, channel, in) -> heard.countDown());
        do {
            bus.publish("LCM_SELF_TEST", test, 0, test.length);
        } while (!heard.await(20, TimeUnit.MILLISECONDS));
    }

    private void await(Beats.Beat beat) throws IOException {
        long wait = beat.left();
        for (Timer timer : timers)
            wait = Math.min(wait, timer.due - System.nanoTime());
        if (wait <= 0 || !inbox.isEmpty())
            selector.selectNow();
        else
            selector.select((wait + MS - 1) / MS);
    }

    private void serveTimers() throws Exception {
        for (int n = 0; n < timers.size() && code < 0; n++) { // a handler may add one
            Timer timer = timers.get(n);
            long late = System.nanoTime() - timer.due;
            if (late < 0)
                continue;
            timer.due += timer.period * (1 + late / timer.period);
            timer.handler.run();
        }
    }

    private void serveChannels() throws Exception {
        for (SelectionKey key : selector.selectedKeys()) {
            if (code < 0 && key.isValid())
                ((Action) key.attachment()).run();
        }
        selector.selectedKeys().clear();
    }

    private void serveInbox() throws Exception {
        for (int n = 0; n < BURST && code < 0; n++) {
            Action action = inbox.take();
            if (action == null)
                return;
            action.run();
        }
    }

    /** Hands the messages of a channel over to the loop: the library calls its subscribers from a thread of its own. */
    private void receive(String channel, Handler<byte[]> handler) {
        bus.subscribe(channel, (LCM lcm, String from, LCMDataInputStream in) -> {
            byte[] data = new byte[in.available()];
            try {
                in.readFully(data);
            } catch (IOException error) { // it has that many
                throw new IllegalStateException(error);
            }
            inbox.put(handler, () -> handler.handle(data));
        });
    }

    final void broken(Throwable error) {
        error.printStackTrace();
        fatal(UNHANDLED, Kind.UNKNOWN, said(error), OTHER);
    }

    /** The error in one text: its class and its message. */
    private static String said(Throwable error) {
        return error.getClass().getSimpleName() + ": " + (error.getMessage() == null ? "" : error.getMessage());
    }

    private void lookForWatchdog() {
        // Checks are counted, not seconds: a delayed process checks once, and then receives the queued messages.
        if (++unheard <= ORPHANED)
            return;
        System.err.println(name + ": the watchdog is gone: it ends");
        end();
    }

    /** True if the table allows a command from one state to another; without TERMINATE. */
    private static boolean allows(State from, State to, boolean manual) {
        switch (to) {
            case RUN: return from == State.PAUSE || from == State.STOP && manual;
            case PAUSE: return from == State.RUN || from == State.STOP && manual;
            case STOP: return manual;
            default: return false;
        }
    }

    private void obey(cmd_state_t command) {
        String module = text(command.module), source = text(command.source);
        if (!module.equals(name) && !module.equals("*") || command.state == state.ordinal() || state == State.TERMINATE)
            return;
        if (command.state < 0 || command.state >= State.values().length) {
            forbidden("command from " + source + " refused: " + command.state + " is no state");
            return;
        }
        State to = State.values()[command.state];
        if (to == State.TERMINATE) {
            end();
        } else if (allows(state, to, command.manual)) {
            if (state == State.INIT)
                wanted = to;
            enter(to);
            // A command led it through STOP out of ERROR; its device is still lost.
            if (lost && (state == State.RUN || state == State.PAUSE))
                failed();
        } else {
            String manner = command.manual ? "manual " : "";
            forbidden(manner + "command " + to + " from " + source + " refused in " + state);
        }
    }

    /**
     * Obeys a command for the level from which reports are sent. Its watchdog prints and sends its lines, and answers.
     */
    private void setLevel(cmd_level_t command) {
        String module = text(command.module);
        if (!module.equals(name) && !module.equals("*"))
            return;
        if (!isLevel(command.print_from) || !isLevel(command.send_from))
            refuseLevel(isLevel(command.print_from) ? command.send_from : command.print_from, text(command.source));
        else if (command.send_from == cmd_level_t.CONFIGURED)
            sendFrom = LEVEL_DEBUG;
        else if (command.send_from != cmd_level_t.UNCHANGED)
            sendFrom = command.send_from;
    }

    private static boolean isLevel(byte value) {
        return value >= LEVEL_DEBUG && value <= LEVEL_ERROR || value == cmd_level_t.UNCHANGED
                || value == cmd_level_t.CONFIGURED;
    }

    /** Counts a refused command for the levels, and reports at most one each second. */
    private void refuseLevel(int value, String source) {
        refused++;
        if (System.nanoTime() - refusal < REFUSALS)
            return;
        String more = refused > 1 ? "; " + refused + " refused since the last report" : "";
        refused = 0;
        refusal = System.nanoTime();
        forbidden("command from " + source + " refused: " + value + " is no level" + more);
    }

    private void forbidden(String text) {
        if (sends(Severity.WARNING))
            report(COMMAND_FORBIDDEN, Kind.UNKNOWN, Severity.WARNING, text, timestamp(), false);
    }

    private boolean sends(Severity severity) {
        return severity.ordinal() + 1 >= sendFrom;
    }

    /** Called before a change of state, for helpers on top of this one. */
    void beforeState(State to) {
    }

    private void enter(State to) {
        beforeState(to);
        state = to;
        announce();
        onState(to);
    }

    private void announceAll() {
        announce();
        list(timestamp());
    }

    private void announce() {
        data_state_t message = new data_state_t();
        message.timestamp = timestamp();
        message.module = wire(name);
        message.state = (byte) state.ordinal();
        publish("CM_DATA_STATE", message);
    }

    /** Publishes the active faults, before the report of the same moment, so that its subject is known. */
    private void list(long now) {
        data_faults_t message = new data_faults_t();
        message.timestamp = now;
        message.module = wire(name);
        message.count = faults.size();
        message.faults = new fault_t[message.count];
        int n = 0;
        for (Entry<Entry<Integer, String>, Active> entry : faults.entrySet()) {
            Active active = entry.getValue();
            fault_t fault = message.faults[n++] = new fault_t();
            fault.number = entry.getKey().getKey();
            fault.subject = clipped(entry.getKey().getValue());
            fault.severity = (byte) active.severity.ordinal();
            fault.since = active.since;
            fault.message = clipped(active.message);
        }
        publish("CM_DATA_FAULTS", message);
    }

    /** The text as a field, truncated to the maximum length in a list; characters are never split. */
    static String clipped(String text) {
        String bytes = wire(text).replace('\0', ' ');
        int end = Math.min(bytes.length(), TEXT_MAX);
        while (end < bytes.length() && end > 0 && (bytes.charAt(end) & 0xC0) == 0x80)
            end--;
        return bytes.substring(0, end);
    }

    private void report(int number, Kind kind, Severity severity, String text, long now, boolean fatal) {
        String own = Module.class.getName();
        StackWalker.StackFrame caller = StackWalker.getInstance().walk(frames -> frames
                .dropWhile(it -> it.getClassName().equals(own) && RAISING.contains(it.getMethodName()))
                .findFirst().orElseThrow());
        error_t message = new error_t();
        message.timestamp = now;
        message.module = wire(name);
        message.number = number;
        message.message = wire(text);
        message.fatal = fatal;
        message.type = (byte) kind.ordinal();
        message.severity = (byte) severity.ordinal();
        message.file = caller.getFileName() == null ? caller.getClassName() : caller.getFileName();
        message.line = caller.getLineNumber();
        publish("CM_EVENT_ERROR", message);
    }
}
