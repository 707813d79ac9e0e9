package advee;

import highlevel.cmd_action_t;
import highlevel.data_action_t;
import highlevel.parameter_t;
import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.HashMap;
import java.util.HashSet;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.regex.Pattern;

/**
 * A module in Java that offers actions: HL_CMD_ACTION and HL_DATA_ACTION (docs/highlevel.md); actions.py in Java.
 *
 * <pre>
 * final class Greeter extends Performer {
 *     Greeter(Arguments arguments) {
 *         super(arguments);
 *         offer("greet", greeting -&gt; greeting.succeed("greeted " + greeting.text("name")), null);
 *         every(0.1, this::working); // it needs no device
 *     }
 * }
 * </pre>
 *
 * The helper answers each command, rejects those beyond the limits and those that come while the module is not in RUN,
 * repeats the status each second, knows repeated commands by their id, and fails what is under way when the module
 * leaves RUN. All calls come from the module's loop, and all methods are called from it: a thread of the module uses
 * {@link Module#post}.
 */
public abstract class Performer extends Module {
    private static final Pattern ID = Pattern.compile("[!-~]{1,128}");
    private static final Pattern NAME = Pattern.compile("[A-Za-z][A-Za-z0-9_.-]{0,63}");
    private static final Pattern NUMBER = Pattern.compile("[-+0-9.eE]+");
    private static final int PARAMETERS_MAX = 32, VALUE_MAX = 4096; // parameters of a command; bytes of a value
    private static final double PERIOD = 1.0; // s between two statuses of an action that lasts
    private static final long AGAIN = 100_000_000; // ns at least between two statuses that differ in the progress alone
    private static final int ENDS = 3;           // times that an end is published
    private static final int UNDER_WAY_MAX = 16; // actions at a time; further ones are rejected
    private static final int ENDED_MAX = 64;     // actions that have ended and are known by their id

    /** Statuses, in the order of their values on the wire. */
    public enum Status { ACCEPTED, RUNNING, SUCCEEDED, FAILED, CANCELLED, REJECTED }

    /** To be thrown when an action is about to begin: it is rejected, with this reason. */
    public static final class Rejected extends Exception {
        private static final long serialVersionUID = 1;

        public Rejected(String reason) {
            super(reason);
        }
    }

    /** An action that was commanded. */
    public final class Performance {
        /** Its id, and the name of the action. */
        public final String id, name;

        private final Map<String, String> parameters = new HashMap<>();
        private Status status = Status.ACCEPTED;
        private double progress = Double.NaN;
        private String message = "", lost = "";
        private boolean cancelling, isPublished;
        private long published;
        private int ends; // times that its end is still published

        private Performance(cmd_action_t command) {
            id = command.id;
            name = command.name;
        }

        /** True once it has ended. */
        public boolean over() {
            return status.compareTo(Status.SUCCEEDED) >= 0;
        }

        /** Returns a parameter; without it the action is rejected. */
        public String text(String key) throws Rejected {
            String value = parameters.get(key);
            if (value == null)
                throw new Rejected("parameter " + key + " is missing");
            return value;
        }

        /** Returns a parameter, or the default. */
        public String text(String key, String otherwise) {
            return parameters.getOrDefault(key, otherwise);
        }

        /** Returns a parameter as a number from low to high, else the action is rejected. */
        public double number(String key, double low, double high) throws Rejected {
            String value = text(key);
            double number = Double.NaN;
            try {
                if (NUMBER.matcher(value).matches())
                    number = Double.parseDouble(value);
            } catch (NumberFormatException error) {
                number = Double.NaN;
            }
            if (!(number >= low && number <= high))
                throw new Rejected("parameter " + key + " is no number from " + brief(low) + " to " + brief(high));
            return number;
        }

        /** The same; without the parameter the default, which needs no limits. */
        public double number(String key, double low, double high, double otherwise) throws Rejected {
            return parameters.containsKey(key) ? number(key, low, high) : otherwise;
        }

        /** Reports that it is under way: progress 0 to 1, or NaN if that is not known; what is done now. */
        public void run(double progress, String message) {
            change(Status.RUNNING, progress, message);
        }

        /** Ends it: it has reached its aim. */
        public void succeed(String message) {
            change(Status.SUCCEEDED, 1.0, message);
        }

        /** Ends it: it has not reached its aim, for this reason. */
        public void fail(String message) {
            change(Status.FAILED, progress, message);
        }

        /** Ends it because it was cancelled; as FAILED where that was because the module left RUN. */
        public void cancelled(String message) {
            if (lost.isEmpty())
                change(Status.CANCELLED, progress, message);
            else
                fail(lost);
        }

        /** Rejects it; after its start it has failed. */
        private void reject(String reason) {
            change(status == Status.ACCEPTED ? Status.REJECTED : Status.FAILED, progress, reason);
        }

        /** Changes the status. After the end nothing changes; a new progress alone is not published too often. */
        private void change(Status to, double progress, String message) {
            if (over())
                return;
            boolean news = status != to || !this.message.equals(message);
            status = to;
            this.message = message;
            this.progress = progress >= 0 && progress <= 1 ? progress : Double.NaN;
            if (news || isOld())
                publishStatus();
            if (over()) {
                ends = ENDS - 1;
                onEnd(this);
            }
        }

        private boolean isOld() {
            return !isPublished || System.nanoTime() - published >= AGAIN;
        }

        private void publishStatus() {
            isPublished = true;
            published = System.nanoTime();
            data_action_t data = new data_action_t();
            data.timestamp = timestamp();
            data.id = id;
            data.status = (byte) status.ordinal();
            data.progress = progress;
            data.message = clipped(message);
            publish("HL_DATA_ACTION", data);
        }
    }

    /** An action that is offered. */
    private static final class Offer {
        private final Handler<Performance> begin, cancel;

        private Offer(Handler<Performance> begin, Handler<Performance> cancel) {
            this.begin = begin;
            this.cancel = cancel;
        }
    }

    private final Map<String, Offer> offers = new HashMap<>();
    /** By their ids, in the order of their commands. */
    private final Map<String, Performance> underWay = new LinkedHashMap<>();
    private final Map<String, Performance> ended = new HashMap<>();
    /** Those that have ended, the oldest first. */
    private final ArrayDeque<Performance> ends = new ArrayDeque<>();

    @SuppressWarnings("this-escape") // nothing is called before run()
    protected Performer(Arguments arguments) {
        super(arguments);
        subscribe("HL_CMD_ACTION", cmd_action_t::new, this::onAction);
        every(PERIOD, this::repeat);
    }

    // --- for the module ---

    /**
     * Offers the action of this name; to be called in the constructor. `begin` is called for each one, in RUN: it starts
     * the work, or throws Rejected, and returns quickly; run() reports progress, succeed(), fail() or cancelled() its
     * end, then or later. `cancel` is called once when it is cancelled, and when the module leaves RUN: what is under
     * way is stopped, and cancelled() called as soon as it is; if `cancel` is null that is at once.
     */
    protected final void offer(String action, Handler<Performance> begin, Handler<Performance> cancel) {
        if (!NAME.matcher(action).matches())
            throw new IllegalArgumentException(action + " is no name of an action");
        offers.put(action, new Offer(begin, cancel));
    }

    /** The actions under way, in the order of their commands. */
    protected final List<Performance> actions() {
        return new ArrayList<>(underWay.values());
    }

    /** A number as people write it: 600 and 0.1. */
    public static String brief(double number) {
        boolean isWhole = number == Math.rint(number) && Math.abs(number) < 1e15;
        return isWhole ? Long.toString((long) number) : Double.toString(number);
    }

    // --- the contract ---

    private void onAction(cmd_action_t command) throws Exception {
        if (!ID.matcher(command.id).matches()) {
            fault(MESSAGE_MALFORMED, Kind.UNKNOWN, Severity.WARNING,
                    "HL_CMD_ACTION: a command without a valid id is dropped", "HL_CMD_ACTION");
            return;
        }
        Performance known = underWay.getOrDefault(command.id, ended.get(command.id));
        if (known != null) {
            if (command.cancel && !known.over())
                cancel(known);
            if (known.isOld())
                known.publishStatus();
        } else if (offers.containsKey(command.name)) {
            begin(new Performance(command), command);
        }
    }

    private void begin(Performance action, cmd_action_t command) throws Exception {
        underWay.put(action.id, action);
        if (command.cancel) {
            action.cancelled("it was not under way");
            return;
        }
        String reason = objection(command);
        if (reason != null) {
            action.reject(reason);
            return;
        }
        for (parameter_t parameter : command.parameters)
            action.parameters.put(parameter.name, text(parameter.value));
        try {
            offers.get(action.name).begin.handle(action);
        } catch (Rejected rejected) {
            action.reject(rejected.getMessage());
        }
        if (!action.isPublished) // its work has begun without a report
            action.publishStatus();
    }

    /** The reason for which a command is rejected; null if there is none. */
    private String objection(cmd_action_t command) {
        if (!acts())
            return name + " is in " + state();
        if (underWay.size() > UNDER_WAY_MAX)
            return name + " has " + UNDER_WAY_MAX + " actions under way";
        if (command.count > PARAMETERS_MAX)
            return command.count + " parameters are more than " + PARAMETERS_MAX;
        Set<String> names = new HashSet<>();
        for (parameter_t parameter : command.parameters)
            if (!NAME.matcher(parameter.name).matches() || !names.add(parameter.name))
                return "a parameter has no valid name, or that of another one";
        // A char of a field is a byte of the message.
        if (Arrays.stream(command.parameters).anyMatch(parameter -> parameter.value.length() > VALUE_MAX))
            return "the value of a parameter has more than " + VALUE_MAX + " bytes";
        return null;
    }

    private void cancel(Performance action) throws Exception {
        if (action.cancelling)
            return;
        action.cancelling = true;
        Handler<Performance> handler = offers.get(action.name).cancel;
        if (handler == null)
            action.cancelled("");
        else
            handler.handle(action);
    }

    /** Keeps an action that has ended, instead of the oldest one. */
    private void onEnd(Performance action) {
        underWay.remove(action.id);
        action.parameters.clear();
        ended.put(action.id, action);
        ends.add(action);
        if (ends.size() > ENDED_MAX)
            ended.remove(ends.remove().id);
    }

    private void repeat() {
        underWay.values().forEach(Performance::publishStatus);
        for (Performance action : ends) {
            if (action.ends > 0) {
                action.ends--;
                action.publishStatus();
            }
        }
    }

    /** When the module leaves RUN, what is under way has failed. */
    @Override
    final void beforeState(State to) {
        if (to == State.RUN)
            return;
        for (Performance action : actions()) {
            action.lost = name + " is in " + to;
            try {
                cancel(action);
            } catch (Exception error) { // of the module's handler: the loop reports it
                broken(error);
            }
            action.cancelled("");
        }
    }
}
