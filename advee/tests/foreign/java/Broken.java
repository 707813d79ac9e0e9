import advee.Arguments;
import advee.Beats;
import advee.Module;

/** Module that fails in every way that the helper must handle, selected by its argument; broken.py in Java. */
final class Broken extends Module {
    private final String how;
    private volatile boolean hangs;

    private Broken(Arguments arguments, String how) {
        super(arguments);
        this.how = how;
        if (how.equals("constructor"))
            throw new IllegalStateException("in its constructor");
        every(0.01, this::onTick);
        if (how.equals("worker")) {
            Thread worker = new Thread(this::work);
            worker.setDaemon(true);
            worker.start();
        }
    }

    private void onTick() {
        working();
        if (how.equals("timer"))
            throw new IllegalStateException("in a timer");
        if (how.equals("device"))
            fatal(0x8001, Kind.DEVICE, "the device burns", DEVICE + 3);
    }

    @Override
    protected void onState(State state) {
        if (how.equals("state") && state == State.PAUSE)
            throw new IllegalStateException("on a command");
        hangs = state == State.PAUSE;
    }

    /** Sends heartbeats except in PAUSE, where it waits for an event that never comes. */
    private void work() {
        Beats.Beat beat = beats.thread("worker");
        while (true) {
            if (!hangs)
                beat.run();
            try {
                Thread.sleep(10);
            } catch (InterruptedException error) {
                return;
            }
        }
    }

    public static void main(String[] args) {
        Arguments arguments = new Arguments("broken_java", "Fails in every way.", args);
        String how = arguments.next("how");
        arguments.end();
        run(() -> new Broken(arguments, how));
    }
}
