// Module that fails in every way that the helper must handle, selected by its argument; broken.py in C#.
using System;
using System.Threading;
using Advee;

sealed class Broken : Module
{
    readonly string how;
    volatile bool hangs;

    Broken(Options options) : base(options)
    {
        how = options.Rest[0];
        if (how == "constructor")
            throw new InvalidOperationException("in its constructor");
        Every(0.01, OnTick);
        if (how == "worker")
            new Thread(Work) { IsBackground = true }.Start();
    }

    void OnTick()
    {
        Working();
        if (how == "timer")
            throw new InvalidOperationException("in a timer");
        if (how == "device")
            Fatal(0x8001, Kind.Device, "the device burns", Exit.Device + 3);
    }

    protected override void OnState(State state)
    {
        if (how == "state" && state == State.Pause)
            throw new InvalidOperationException("on a command");
        hangs = state == State.Pause;
    }

    // Sends heartbeats except in PAUSE, where it waits for an event that never comes.
    void Work()
    {
        Action beat = Beats.Thread("worker");
        while (true)
        {
            if (!hangs)
                beat();
            Thread.Sleep(10);
        }
    }

    static void Main(string[] args)
    {
        var options = new Options("broken_csharp", args);
        options.Expect(1);
        Run(() => new Broken(options));
    }
}
