import advee.Arguments;
import advee.Module;
import java.util.Locale;
import lowlevel.data_power_t;

/**
 * Reports a low battery voltage, long before the charge is near the reserve: a weak cell shows under load.
 *
 * <pre>BatteryWatch [--below VOLTS]</pre>
 *
 * A module in Java: docs/writing-a-module.md. Its device is LL_DATA_POWER.
 */
final class BatteryWatch extends Module {
    private static final double MARGIN = 0.5;          // V above the limit: clears the fault
    private static final long SILENT_NS = 3_000_000_000L; // the power controller is polled each second
    private static final int POWER_SILENT = 0x8001, BATTERY_SAGS = 0x8002;

    private final double below;
    private long heard = System.nanoTime();

    private BatteryWatch(Arguments arguments, double below) {
        super(arguments);
        this.below = below;
        subscribe("LL_DATA_POWER", data_power_t::new, this::onPower);
        every(0.2, this::onLook);
    }

    private void onPower(data_power_t power) {
        heard = System.nanoTime();
        clear(POWER_SILENT, "LL_DATA_POWER is heard again");
        working();
        if (acts() && power.voltage < below)
            fault(BATTERY_SAGS, Kind.RESOURCE, Severity.WARNING,
                    format("the battery has %.1f V, less than %.1f V", power.voltage, below));
        else if (acts() && power.voltage >= below + MARGIN)
            clear(BATTERY_SAGS, format("the battery has %.1f V again", power.voltage));
    }

    private void onLook() {
        if (System.nanoTime() - heard >= SILENT_NS) {
            fault(POWER_SILENT, Kind.TIMEOUT, Severity.ERROR, "no LL_DATA_POWER: is driver_power there?");
            failed();
        }
    }

    private static String format(String text, Object... values) {
        return String.format(Locale.ROOT, text, values);
    }

    public static void main(String[] args) {
        Arguments arguments = new Arguments("battery_watch", "Reports a battery that sags.", args);
        double below = arguments.number("--below", "VOLTS", 25.0, "report below this voltage (25)");
        arguments.end();
        run(() -> new BatteryWatch(arguments, below));
    }
}
