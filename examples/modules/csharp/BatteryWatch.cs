// Reports a low battery voltage, long before the charge is near the reserve: a weak cell shows under load.
//
//     mono BatteryWatch.exe [--below VOLTS]
//
// A module in C#: docs/writing-a-module.md. Its device is LL_DATA_POWER.
using System.Globalization;
using Advee;
using lowlevel;

sealed class BatteryWatch : Module
{
    const double Margin = 0.5; // V above the limit: clears the fault
    const double Silent = 3.0; // s; the power controller is polled each second
    const int PowerSilent = 0x8001, BatterySags = 0x8002;

    readonly double below;
    double heard = Clock.Now;

    BatteryWatch(Options options, double below) : base(options)
    {
        this.below = below;
        Subscribe<data_power_t>("LL_DATA_POWER", OnPower);
        Every(0.2, OnLook);
    }

    void OnPower(data_power_t power)
    {
        heard = Clock.Now;
        Clear(PowerSilent, "LL_DATA_POWER is heard again");
        Working();
        if (Acts && power.voltage < below)
            Fault(BatterySags, Kind.Resource, Severity.Warning,
                "the battery has " + Volts(power.voltage) + ", less than " + Volts(below));
        else if (Acts && power.voltage >= below + Margin)
            Clear(BatterySags, "the battery has " + Volts(power.voltage) + " again");
    }

    void OnLook()
    {
        if (Clock.Now - heard < Silent)
            return;
        Fault(PowerSilent, Kind.Timeout, Severity.Error, "no LL_DATA_POWER: is driver_power there?");
        Failed();
    }

    static string Volts(double value) { return value.ToString("F1", CultureInfo.InvariantCulture) + " V"; }

    static void Main(string[] args)
    {
        var options = new Options("battery_watch", args, "--below");
        options.Expect(0);
        double below;
        string text = options["--below"] ?? "25";
        if (!double.TryParse(text, NumberStyles.Float, CultureInfo.InvariantCulture, out below))
            options.Refuse("argument --below: invalid float value: '" + text + "'");
        Run(() => new BatteryWatch(options, below));
    }
}
