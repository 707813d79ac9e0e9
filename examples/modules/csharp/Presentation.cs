// Plays presentations: shows a text, sentence by sentence, in a given time.
//
//     mono Presentation.exe
//     advee action present text="Good morning. My name is Advee." seconds=6
//
// A module in C# that offers an action: docs/highlevel.md; presentation.py in C#. The sentences are lines on its
// standard error, which its watchdog prints and sends on CM_EVENT_TEXT.
using System;
using System.Text.RegularExpressions;
using Advee;

sealed class Presentation : Performer
{
    const double Rate = 15.0;                    // characters that people read in a second
    const double Shortest = 0.1, Longest = 600.0; // s; limits of the parameter
    const double Tick = 0.1;                     // s

    Performance action; // that is played; null: none
    string[] sentences = { };
    int shown;
    double begun, seconds;

    Presentation(Options options) : base(options)
    {
        Offer("present", OnPresent, OnCancel);
        Every(Tick, OnTick);
    }

    void OnPresent(Performance next)
    {
        if (action != null)
            throw new RejectedException(action.Id + " is played");
        string text = Regex.Replace(next.Text("text").Trim(), @"\s+", " ");
        if (text == "")
            throw new RejectedException("the text is empty");
        double usual = Math.Min(Math.Max(2.0, text.Length / Rate), Longest);
        seconds = next.Number("seconds", Shortest, Longest, usual);
        sentences = Regex.Split(text, "(?<=[.!?]) ");
        shown = 0;
        action = next;
        begun = Clock.Now;
        Play();
    }

    void OnCancel(Performance cancelled)
    {
        action = null;
        cancelled.Cancelled("after " + shown + " of " + sentences.Length + " sentences");
    }

    void OnTick()
    {
        Working();
        if (action != null)
            Play();
    }

    void Play()
    {
        double share = (Clock.Now - begun) / seconds;
        int due = Math.Min((int) (share * sentences.Length) + 1, sentences.Length);
        for (; shown < due; ++shown)
            Console.Error.WriteLine("<6>" + sentences[shown]);
        if (share < 1)
        {
            action.Run(share, sentences[due - 1]);
            return;
        }
        Performance done = action;
        action = null;
        done.Succeed(due + " sentences in " + Performance.Brief(seconds) + " s");
    }

    static void Main(string[] args)
    {
        var options = new Options("presentation", args);
        options.Expect(0);
        Run(() => new Presentation(options));
    }
}
