package advee;

import java.util.ArrayList;
import java.util.List;

/**
 * The command line of a module: --name, --state (RUN, PAUSE or STOP: the one after INIT) and --lcm-url, and what the
 * module asks for. The watchdog passes the same by the environment variables ADVEE_MODULE, ADVEE_STATE and
 * LCM_DEFAULT_URL; arguments have priority. An invalid command line ends the process with RESOURCE.
 */
public final class Arguments {
    public final String name, lcmUrl;
    public final Module.State state;

    private final String program, description;
    private final List<String> rest;
    private final StringBuilder help = new StringBuilder();

    /** Of the program with this default name; `given` is what main() was given. */
    public Arguments(String program, String description, String... given) {
        this.program = program;
        this.description = description;
        rest = new ArrayList<>(List.of(given));
        name = text("--name", "NAME", variable("ADVEE_MODULE", program), "its name on the bus");
        String first = text("--state", "STATE", variable("ADVEE_STATE", "RUN"),
                "its state after INIT: RUN, PAUSE or STOP");
        if (!List.of("RUN", "PAUSE", "STOP").contains(first))
            throw refuse("argument --state: " + first + ": expected RUN, PAUSE or STOP");
        state = Module.State.valueOf(first);
        lcmUrl = text("--lcm-url", "URL", variable("LCM_DEFAULT_URL", "udpm://239.255.76.67:7667?ttl=0"),
                "the LCM bus");
    }

    /** The value of an option, or the other one; `value` stands for it in the help. */
    public String text(String option, String value, String otherwise, String help) {
        this.help.append(String.format("  %-20s  %s%n", option + " " + value, help));
        String found = otherwise;
        for (int at; (at = rest.indexOf(option)) >= 0; rest.remove(at)) { // the last one counts
            rest.remove(at);
            if (at == rest.size() || rest.get(at).startsWith("--"))
                throw refuse("argument " + option + ": expected one argument");
            found = rest.get(at);
        }
        return found;
    }

    /** The number that is the value of an option, or the other one. */
    public double number(String option, String value, double otherwise, String help) {
        String found = text(option, value, Double.toString(otherwise), help);
        try {
            return Double.parseDouble(found);
        } catch (NumberFormatException error) {
            throw refuse("argument " + option + ": invalid float value: '" + found + "'");
        }
    }

    /** The next argument that is no option; to be called when all options have been asked for. */
    public String next(String value) {
        help.append("  ").append(value).append(System.lineSeparator());
        if (rest.isEmpty() || rest.get(0).startsWith("-")) {
            end();
            throw refuse("the following arguments are required: " + value);
        }
        return rest.remove(0);
    }

    /** To be called when everything has been asked for: prints the help if it is wanted, refuses what is left. */
    public void end() {
        if (rest.contains("-h") || rest.contains("--help")) {
            System.out.printf("%s: %s%n%s", program, description, help);
            System.exit(0);
        }
        if (!rest.isEmpty())
            throw refuse("unrecognized arguments: " + String.join(" ", rest));
    }

    /** Prints the reason and exits with RESOURCE; it does not return, which `throw` tells the compiler. */
    public IllegalArgumentException refuse(String why) {
        System.err.println((name == null ? program : name) + ": " + why);
        System.exit(Module.RESOURCE);
        return new IllegalArgumentException(why);
    }

    private static String variable(String key, String otherwise) {
        String value = System.getenv(key);
        return value == null || value.isEmpty() ? otherwise : value;
    }
}
