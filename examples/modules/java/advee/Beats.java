package advee;

import java.io.IOException;
import java.nio.ByteBuffer;
import java.nio.ByteOrder;
import java.nio.MappedByteBuffer;
import java.nio.channels.FileChannel;
import java.nio.charset.StandardCharsets;
import java.nio.file.LinkOption;
import java.nio.file.Path;
import java.nio.file.StandardOpenOption;
import java.util.Arrays;

/**
 * The heartbeat page of this process (docs/beats.md). Without a page, when started by hand, it has no effect. The
 * counters are written through a mapping, because an interrupt of a thread would close the file for all of them.
 */
public final class Beats {
    private static final long BEAT_NS = 50_000_000; // between two heartbeats
    private static final int SIZE = 4096, HEAD = 64, ENTRY = 64, NAME = 48, THREADS_MAX = 63;

    private FileChannel file;
    private MappedByteBuffer page;
    private int threads;

    /** The page at this path; none if it is null or empty. */
    Beats(String path) {
        if (path == null || path.isEmpty())
            return;
        try {
            file = FileChannel.open(Path.of(path), StandardOpenOption.READ, StandardOpenOption.WRITE,
                    LinkOption.NOFOLLOW_LINKS);
            if (file.size() < SIZE) // mapped, it would grow
                throw new IOException("it has " + file.size() + " bytes");
            page = file.map(FileChannel.MapMode.READ_WRITE, 0, SIZE);
            page.order(ByteOrder.LITTLE_ENDIAN);
        } catch (IOException error) {
            System.err.println("no page of beats: " + path + ": " + error);
        }
    }

    /**
     * Returns the heartbeat of the thread of that name, for use by that thread only. From this call on silence is a
     * hang, so make it when the loop begins. Maximum number of threads: 63.
     */
    public synchronized Beat thread(String name) {
        if (page == null || threads == THREADS_MAX)
            return new Beat(-1);
        int place = HEAD + ENTRY * threads;
        byte[] bytes = Arrays.copyOf(name.getBytes(StandardCharsets.UTF_8), NAME);
        for (int n = 0; n < NAME; n++)
            page.put(place + n, bytes[n]);
        page.putInt(place + NAME, 1);
        ByteBuffer head = ByteBuffer.allocate(16).order(ByteOrder.LITTLE_ENDIAN);
        head.put(new byte[] {'B', 'E', 'A', 'T'}).putInt(1).putInt((int) ProcessHandle.current().pid());
        head.putInt(threads + 1).flip();
        try {
            // In one piece, because it is read at any time, and last: an entry counts when it is complete.
            file.write(head, 0);
        } catch (IOException error) {
            System.err.println("page of beats: " + error);
            return new Beat(-1);
        }
        threads++;
        return new Beat(place + NAME);
    }

    /** The heartbeat of one thread. */
    public final class Beat implements Runnable {
        private final int place;
        private int count = 1;
        private long due = System.nanoTime() + BEAT_NS;

        private Beat(int place) {
            this.place = place;
        }

        /** To be called in the thread's loop at least each 50 ms; does not block. */
        @Override
        public void run() {
            long now = System.nanoTime();
            if (place < 0 || now - due < 0)
                return;
            due = now + BEAT_NS;
            page.putInt(place, ++count);
        }

        /** Time until the next one, ns; without a page there is none. */
        long left() {
            return place < 0 ? Long.MAX_VALUE : due - System.nanoTime();
        }
    }
}
