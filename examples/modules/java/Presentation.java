import advee.Arguments;
import advee.Performer;

/**
 * Plays presentations: shows a text, sentence by sentence, in a given time.
 *
 * <pre>advee action present text="Good morning. My name is Advee." seconds=6</pre>
 *
 * A module in Java that offers an action: docs/highlevel.md; presentation.py in Java. The sentences are lines on its
 * standard error, which its watchdog prints and sends on CM_EVENT_TEXT.
 */
final class Presentation extends Performer {
    private static final double RATE = 15.0;                     // characters that people read in a second
    private static final double SHORTEST = 0.1, LONGEST = 600.0; // s; limits of the parameter
    private static final double TICK = 0.1;                      // s

    private Performance action; // that is played; null: none
    private String[] sentences = {};
    private int shown;
    private long begun;
    private double seconds;

    private Presentation(Arguments arguments) {
        super(arguments);
        offer("present", this::onPresent, this::onCancel);
        every(TICK, this::onTick);
    }

    private void onPresent(Performance next) throws Rejected {
        if (action != null)
            throw new Rejected(action.id + " is played");
        String text = next.text("text").strip().replaceAll("\\s+", " ");
        if (text.isEmpty())
            throw new Rejected("the text is empty");
        double usual = Math.min(Math.max(2.0, text.length() / RATE), LONGEST);
        seconds = next.number("seconds", SHORTEST, LONGEST, usual);
        sentences = text.split("(?<=[.!?]) ");
        shown = 0;
        action = next;
        begun = System.nanoTime();
        play();
    }

    private void onCancel(Performance cancelled) {
        action = null;
        cancelled.cancelled("after " + shown + " of " + sentences.length + " sentences");
    }

    private void onTick() {
        working();
        if (action != null)
            play();
    }

    private void play() {
        double share = 1e-9 * (System.nanoTime() - begun) / seconds;
        int due = Math.min((int) (share * sentences.length) + 1, sentences.length);
        for (; shown < due; shown++)
            System.err.println("<6>" + sentences[shown]);
        if (share < 1) {
            action.run(share, sentences[due - 1]);
            return;
        }
        Performance done = action;
        action = null;
        done.succeed(due + " sentences in " + brief(seconds) + " s");
    }

    public static void main(String[] args) {
        Arguments arguments = new Arguments("presentation", "Plays presentations.", args);
        arguments.end();
        run(() -> new Presentation(arguments));
    }
}
