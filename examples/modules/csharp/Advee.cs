// The contract of a module, for modules in C# on Lcm.cs (docs/writing-a-module.md).
//
//     sealed class Watch : Module
//     {
//         Watch(Options options) : base(options)
//         {
//             Subscribe<data_power_t>("LL_DATA_POWER", power => Working());
//         }
//
//         static void Main(string[] args)
//         {
//             Run(() => new Watch(new Options("watch", args)));
//         }
//     }
//
// One loop serves the bus, timers and the module's own descriptors, and sends heartbeats; all handlers are called from
// it and must return quickly: one that takes 200 ms is a hang. Around them the loop announces the state each second and
// on change, obeys state commands by the table, reports each fault when it is raised and when it is cleared, lists the
// active ones, and ends at TERMINATE, at SIGTERM, and when the watchdog that started it is gone without a successor.
// Needs the output of the official lcm-gen for messages/*.lcm, and Mono.Posix. advee.py: the same in Python.
using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Net.Sockets;
using System.Reflection;
using System.Runtime.CompilerServices;
using System.Text;
using System.Threading;
using LCM.LCM;
using Mono.Unix;
using Mono.Unix.Native;

namespace Advee
{
    /// <summary>The states of a module, by their values on the wire.</summary>
    public enum State : sbyte { Unknown, Init, Stop, Run, Error, Terminate, Pause }

    /// <summary>Type of a fault.</summary>
    public enum Kind : sbyte { Unknown, Timeout, Resource, Device }

    /// <summary>Severity: information, irregularity, work that is not being done.</summary>
    public enum Severity : sbyte { Notice, Warning, Error }

    /// <summary>Exit codes: a class plus a number 0 to 16.</summary>
    public static class Exit
    {
        public const int Resource = 0x10, Device = 0x20, Other = 0x40;
    }

    public static class Clock
    {
        static readonly double start = (DateTime.UtcNow - new DateTime(1970, 1, 1)).TotalSeconds - Now;

        /// <summary>Monotonic time, s: for deadlines.</summary>
        public static double Now { get { return (double) Stopwatch.GetTimestamp() / Stopwatch.Frequency; } }

        /// <summary>Current time for messages, µs since 1970; a step of the wall clock never turns it back.</summary>
        public static long Timestamp { get { return (long) ((start + Now) * 1e6); } }
    }

    /// <summary>The command line of a module: --name, --state (RUN, PAUSE or STOP: the one after INIT), --lcm-url, and
    /// the module's own options, each with a value; other arguments are kept in Rest. The watchdog passes the same by
    /// the environment variables ADVEE_MODULE, ADVEE_STATE and LCM_DEFAULT_URL; arguments have priority. An invalid
    /// command line ends the process.</summary>
    public sealed class Options
    {
        readonly Dictionary<string, string> values = new Dictionary<string, string>();

        public readonly List<string> Rest = new List<string>();

        public Options(string module, string[] args, params string[] own)
        {
            values["--name"] = Variable("ADVEE_MODULE", module);
            values["--state"] = Variable("ADVEE_STATE", "RUN");
            values["--lcm-url"] = Variable("LCM_DEFAULT_URL", "udpm://239.255.76.67:7667?ttl=0");
            foreach (string option in own)
                values[option] = null;
            for (int n = 0; n < args.Length; ++n)
            {
                string[] parts = args[n].Split(new[] { '=' }, 2);
                if (!values.ContainsKey(parts[0]))
                    Rest.Add(args[n]);
                else if (parts.Length == 2)
                    values[parts[0]] = parts[1];
                else if (++n < args.Length)
                    values[parts[0]] = args[n];
                else
                    Refuse("argument " + parts[0] + ": expected one argument");
            }
            string first = values["--state"];
            if (first != "RUN" && first != "PAUSE" && first != "STOP")
                Refuse("argument --state: " + first + ": expected RUN, PAUSE or STOP");
            State = (State) Enum.Parse(typeof(State), first, true);
        }

        public string Name { get { return values["--name"]; } }
        public string LcmUrl { get { return values["--lcm-url"]; } }
        public State State { get; private set; }

        /// <summary>Value of an option of the module's own; null if it is not given.</summary>
        public string this[string option] { get { return values[option]; } }

        /// <summary>Refuses arguments beyond the expected number.</summary>
        public void Expect(int arguments)
        {
            if (Rest.Count < arguments)
                Refuse("expected " + (arguments - Rest.Count) + " more arguments");
            if (Rest.Count > arguments)
                Refuse("unrecognized arguments: " + string.Join(" ", Rest.Skip(arguments)));
        }

        /// <summary>Prints the reason and exits with Resource: the command line is invalid.</summary>
        public void Refuse(string why)
        {
            Console.Error.WriteLine(Name + ": " + why);
            Environment.Exit(Exit.Resource);
        }

        static string Variable(string key, string otherwise)
        {
            string value = Environment.GetEnvironmentVariable(key);
            return string.IsNullOrEmpty(value) ? otherwise : value;
        }
    }

    /// <summary>The heartbeat page of this process (docs/beats.md). Without a page, when started by hand, it has no
    /// effect.</summary>
    public sealed class Beats
    {
        const double Period = Module.Beat;

        readonly UnixStream page;
        int threads;

        public Beats()
        {
            string path = Environment.GetEnvironmentVariable("ADVEE_BEATS");
            if (string.IsNullOrEmpty(path))
                return;
            int descriptor = Syscall.open(path, OpenFlags.O_WRONLY | OpenFlags.O_NOFOLLOW | OpenFlags.O_CLOEXEC);
            if (descriptor >= 0)
                page = new UnixStream(descriptor);
            else
                Console.Error.WriteLine("no page of beats: " + path + ": " + Stdlib.strerror(Stdlib.GetLastError()));
        }

        public bool Any { get { return page != null; } }

        /// <summary>Returns an action for the thread of that name to call in its loop at least each 50 ms; it does not
        /// block. From this call on silence is a hang, so make it when the loop begins. Maximum number of threads:
        /// 63.</summary>
        public Action Thread(string name)
        {
            if (page == null)
                return () => { };
            long place;
            lock (page)
            {
                if (threads == 63)
                    return () => { };
                place = 64 + 64 * threads++;
                var entry = new byte[64];
                byte[] text = Encoding.UTF8.GetBytes(name);
                Array.Copy(text, entry, Math.Min(text.Length, 48));
                entry[48] = 1;
                page.WriteAtOffset(entry, 0, entry.Length, place);
                // The number of threads last: an entry counts when it is complete.
                var numbers = new[] { 1, Syscall.getpid(), threads };
                byte[] head = Encoding.ASCII.GetBytes("BEAT").Concat(numbers.SelectMany(LittleEndian)).ToArray();
                page.WriteAtOffset(head, 0, head.Length, 0);
            }
            int count = 1;
            double due = Clock.Now + Period;
            return () =>
            {
                double now = Clock.Now;
                if (now < due)
                    return;
                due = now + Period;
                page.WriteAtOffset(LittleEndian(++count), 0, 4, place + 48);
            };
        }

        static byte[] LittleEndian(int value)
        {
            return new[] { (byte) value, (byte) (value >> 8), (byte) (value >> 16), (byte) (value >> 24) };
        }
    }

    /// <summary>A module: derive from it, subscribe in the constructor, call Working() when the device is
    /// there.</summary>
    public abstract class Module
    {
        /// <summary>Fault numbers shared by all modules (docs/faults.md). A module's own begin at 0x8001.</summary>
        public const int CommandForbidden = 0x0001, MessageMalformed = 0x0002, Unhandled = 0x8000;

        internal const double Beat = 0.05; // s between two heartbeats
        const double Announcement = 1.0;   // s between two announcements
        const double Look = 0.5;           // s between two checks for the watchdog
        const int Orphaned = 6;            // checks without CM_DATA_PROCESSES: it is gone, without a successor
        const int FaultsMax = 256;         // active faults in a list; further ones are not reported
        const int TextMax = 512;           // bytes of a subject or a message in a list
        const int LevelDebug = 0, LevelError = 3; // a severity is of the level above its value
        const double Refusals = 1.0;       // s at least between two reports of refused commands for the levels
        const int Burst = 64;              // datagrams per turn of the loop: a flood delays nothing else for long

        sealed class Timer
        {
            public double Due, Period;
            public Action Handler;
        }

        /// <summary>An active fault: as it was last raised, and the time when it was first raised.</summary>
        sealed class Active
        {
            public int Number;
            public string Subject, Message;
            public Kind Kind;
            public Severity Severity;
            public long Since;
            public bool Sent; // its begin was reported, so its end will be
        }

        readonly LCM.LCM.LCM lcm;
        readonly List<Active> faults = new List<Active>();
        readonly List<Timer> timers = new List<Timer>();
        readonly List<int> descriptors = new List<int>();
        readonly List<Action> handlers = new List<Action>();
        State wanted, beforeError = State.Init;
        bool lost;
        int sendFrom = LevelDebug; // level from which reports are sent
        int refused; // commands for the levels since the last report of one
        double refusal = Clock.Now - Refusals; // time of that report
        int unheard;
        int? code;

        /// <summary>Its name on the bus.</summary>
        public readonly string Name;

        /// <summary>For the module's own threads; the loop's heartbeat is built in.</summary>
        public readonly Beats Beats = new Beats();

        protected Module(Options options)
        {
            Name = options.Name;
            State = State.Init;
            wanted = options.State;
            try
            {
                lcm = new LCM.LCM.LCM(options.LcmUrl);
            }
            catch (Exception error) when (error is ArgumentException || error is SocketException)
            {
                options.Refuse("LCM at " + options.LcmUrl + ": " + error.Message);
            }
            CatchSignals();
            Subscribe<common.cmd_state_t>("CM_CMD_STATE", Obey);
            Subscribe<common.cmd_level_t>("CM_CMD_LEVEL", SetLevel);
            Watch(lcm.FileDescriptor, OnBus);
            if (Environment.GetEnvironmentVariable("ADVEE_GUARDED") != null) // a watchdog has started us
            {
                lcm.Subscribe("CM_DATA_PROCESSES", (channel, data) => unheard = 0);
                Every(Look, LookForWatchdog);
            }
        }

        /// <summary>Creates the module, runs it, and ends the process with its exit code.</summary>
        public static void Run(Func<Module> create)
        {
            int code;
            try
            {
                code = create().Loop();
            }
            catch (Exception error) // of its constructor: it has not spoken yet
            {
                Console.Error.WriteLine(error);
                code = Exit.Other;
            }
            Environment.Exit(code);
        }

        // --- for the module ---

        /// <summary>Called after a change of state has been announced. In Terminate it is the last call.</summary>
        protected virtual void OnState(State state) { }

        public State State { get; private set; }

        /// <summary>True if the module may act: only in Run.</summary>
        public bool Acts { get { return State == State.Run; } }

        /// <summary>Calls the handler for each message. A message of another type is dropped and reported
        /// once.</summary>
        protected void Subscribe<T>(string channel, Action<T> handler) where T : LCMEncodable
        {
            ConstructorInfo decode = typeof(T).GetConstructor(new[] { typeof(byte[]) });
            lcm.Subscribe(channel, (from, data) =>
            {
                T message;
                try
                {
                    message = (T) decode.Invoke(new object[] { data });
                }
                catch (Exception error) // of any kind: counts that are invalid, a message that ends early
                {
                    string text = channel + ": a message of " + data.Length + " bytes is dropped: "
                        + (error.InnerException ?? error).Message;
                    Fault(MessageMalformed, Kind.Unknown, Severity.Warning, text, channel);
                    return;
                }
                handler(message);
            });
        }

        /// <summary>Publishes a message of a type generated by lcm-gen. One that the system does not take is lost, as
        /// LCM loses others.</summary>
        public void Publish(string channel, LCMEncodable message)
        {
            try
            {
                lcm.Publish(channel, message);
            }
            catch (SocketException) { }
        }

        /// <summary>Calls the handler with this period; missed calls are dropped.</summary>
        protected void Every(double seconds, Action handler)
        {
            timers.Add(new Timer { Due = Clock.Now + seconds, Period = seconds, Handler = handler });
        }

        /// <summary>Calls the handler when this descriptor is readable.</summary>
        protected void Watch(int descriptor, Action handler)
        {
            descriptors.Add(descriptor);
            handlers.Add(handler);
        }

        /// <summary>Reports the device as present: leads out of Init, and out of Error to the previous state. May be
        /// repeated.</summary>
        protected void Working()
        {
            lost = false;
            if (State == State.Error && beforeError != State.Init)
                Enter(beforeError);
            else if (State == State.Init || State == State.Error)
                Enter(wanted);
        }

        /// <summary>Reports the device as lost: Error, until Working(). Keep trying. May be repeated.</summary>
        protected void Failed()
        {
            lost = true;
            if (State == State.Error || State == State.Terminate)
                return;
            beforeError = State;
            Enter(State.Error);
        }

        /// <summary>Raises a fault; reported once until Clear(). The meaning of its number, 0x8001 or above, never
        /// changes; the subject distinguishes faults of one number. Raised again, it is listed with the new severity
        /// and text.</summary>
        protected void Fault(int number, Kind kind, Severity severity, string text, string subject = "",
            [CallerFilePath] string file = "", [CallerLineNumber] int line = 0)
        {
            Active active = Find(number, subject);
            long now = Clock.Timestamp;
            if (active != null)
            {
                bool news = active.Severity != severity;
                active.Severity = severity;
                active.Message = text;
                if (news)
                    List(now);
            }
            else if (faults.Count < FaultsMax)
            {
                bool sent = Sends(severity);
                faults.Add(new Active { Number = number, Subject = subject, Kind = kind, Severity = severity,
                    Since = now, Message = text, Sent = sent });
                List(now);
                if (sent)
                    Report(number, kind, severity, text, now, false, file, line);
            }
        }

        /// <summary>Clears a fault; reported if it was active.</summary>
        protected void Clear(int number, string text, string subject = "", [CallerFilePath] string file = "",
            [CallerLineNumber] int line = 0)
        {
            Active active = Find(number, subject);
            if (active == null)
                return;
            long now = Clock.Timestamp;
            faults.Remove(active);
            List(now);
            if (active.Sent)
                Report(number, active.Kind, Severity.Notice, text, now, false, file, line);
        }

        /// <summary>Reports a fatal error, and ends with this exit code, or the kind's one. The watchdog restarts the
        /// module.</summary>
        protected void Fatal(int number, Kind kind, string text, int exit = 0, [CallerFilePath] string file = "",
            [CallerLineNumber] int line = 0)
        {
            Report(number, kind, Severity.Error, text, Clock.Timestamp, true, file, line);
            int byKind = kind == Kind.Resource ? Exit.Resource : kind == Kind.Device ? Exit.Device : Exit.Other;
            code = exit != 0 ? exit : byKind;
        }

        /// <summary>Ends the module in good order, as a TERMINATE command does.</summary>
        protected void End()
        {
            if (State == State.Terminate)
                return;
            Enter(State.Terminate);
            code = code ?? 0;
        }

        // --- the loop ---

        /// <summary>Runs until the module ends, and returns the exit code.</summary>
        int Loop()
        {
            try
            {
                AnnounceAll();
                Every(Announcement, AnnounceAll);
                Action beat = Beats.Thread("main");
                while (code == null)
                {
                    beat();
                    ServeTimers();
                    if (code == null)
                        Wait();
                }
            }
            catch (Exception error)
            {
                Console.Error.WriteLine(error);
                Fatal(Unhandled, Kind.Unknown, error.GetType().Name + ": " + error.Message, Exit.Other);
            }
            return code.Value;
        }

        /// <summary>SIGTERM and SIGINT end the module: a thread waits for them and wakes the loop by a pipe.</summary>
        void CatchSignals()
        {
            var asked = new[] { new UnixSignal(Signum.SIGTERM), new UnixSignal(Signum.SIGINT) };
            UnixPipes pipe = UnixPipes.CreatePipes();
            Watch(pipe.Reading.Handle, () =>
            {
                pipe.Reading.ReadByte();
                End();
            });
            var waits = new Thread(() =>
            {
                UnixSignal.WaitAny(asked);
                pipe.Writing.WriteByte(0);
            });
            waits.IsBackground = true;
            waits.Start();
        }

        void ServeTimers()
        {
            for (int n = 0; n < timers.Count && code == null; ++n) // a handler may add one
            {
                Timer timer = timers[n];
                double late = Clock.Now - timer.Due;
                if (late < 0)
                    continue;
                timer.Due += timer.Period * (1 + Math.Floor(late / timer.Period));
                timer.Handler();
            }
        }

        void Wait()
        {
            double wait = Math.Min(timers.Min(timer => timer.Due) - Clock.Now, Beats.Any ? Beat : Announcement);
            Pollfd[] polled = descriptors.Select(fd => new Pollfd { fd = fd, events = PollEvents.POLLIN }).ToArray();
            if (Syscall.poll(polled, (int) Math.Ceiling(1000 * Math.Max(0, wait))) <= 0)
                return;
            for (int n = 0; n < polled.Length && code == null; ++n)
                if (polled[n].revents != 0)
                    handlers[n]();
        }

        void OnBus()
        {
            for (int n = 0; n < Burst && code == null && lcm.HandleDatagram(); ++n) { }
        }

        void LookForWatchdog()
        {
            // Checks are counted, not seconds: a delayed process checks once, and then receives the queued messages.
            if (++unheard <= Orphaned)
                return;
            Console.Error.WriteLine(Name + ": the watchdog is gone: it ends");
            End();
        }

        /// <summary>True if the table allows a command from one state to another; without Terminate.</summary>
        static bool Allows(State from, State to, bool manual)
        {
            switch (to)
            {
                case State.Run: return from == State.Pause || (from == State.Stop && manual);
                case State.Pause: return from == State.Run || (from == State.Stop && manual);
                case State.Stop: return manual;
                default: return false;
            }
        }

        void Obey(common.cmd_state_t command)
        {
            var to = (State) command.state;
            if ((command.module != Name && command.module != "*") || to == State || State == State.Terminate)
                return;
            if (!Enum.IsDefined(typeof(State), to))
                Refused("command from " + command.source + " refused: " + command.state + " is no state");
            else if (to == State.Terminate)
                End();
            else if (!Allows(State, to, command.manual))
                Refused((command.manual ? "manual " : "") + "command " + Wire(to) + " from " + command.source
                    + " refused in " + Wire(State));
            else
            {
                if (State == State.Init)
                    wanted = to;
                Enter(to);
                // A command led it through STOP out of ERROR; its device is still lost.
                if (lost && (State == State.Run || State == State.Pause))
                    Failed();
            }
        }

        /// <summary>Obeys a command for the level from which reports are sent. Its watchdog prints and sends its lines,
        /// and answers.</summary>
        void SetLevel(common.cmd_level_t command)
        {
            if (command.module != Name && command.module != "*")
                return;
            if (!IsLevel(command.print_from) || !IsLevel(command.send_from))
                RefuseLevel(IsLevel(command.print_from) ? command.send_from : command.print_from, command.source);
            else if (command.send_from == common.cmd_level_t.CONFIGURED)
                sendFrom = LevelDebug;
            else if (command.send_from != common.cmd_level_t.UNCHANGED)
                sendFrom = command.send_from;
        }

        static bool IsLevel(sbyte value)
        {
            return (value >= LevelDebug && value <= LevelError) || value == common.cmd_level_t.UNCHANGED
                || value == common.cmd_level_t.CONFIGURED;
        }

        /// <summary>Counts a refused command for the levels, and reports at most one each second.</summary>
        void RefuseLevel(int value, string source)
        {
            ++refused;
            if (Clock.Now - refusal < Refusals)
                return;
            string more = refused > 1 ? "; " + refused + " refused since the last report" : "";
            refused = 0;
            refusal = Clock.Now;
            Refused("command from " + source + " refused: " + value + " is no level" + more);
        }

        bool Sends(Severity severity) { return (int) severity + 1 >= sendFrom; }

        void Refused(string text, [CallerFilePath] string file = "", [CallerLineNumber] int line = 0)
        {
            if (Sends(Severity.Warning))
                Report(CommandForbidden, Kind.Unknown, Severity.Warning, text, Clock.Timestamp, false, file, line);
        }

        /// <summary>Called before a change of state, for helpers on top of this one.</summary>
        internal virtual void BeforeState(State to) { }

        void Enter(State to)
        {
            BeforeState(to);
            State = to;
            Announce();
            OnState(to);
        }

        void AnnounceAll()
        {
            Announce();
            List(Clock.Timestamp);
        }

        void Announce()
        {
            Publish("CM_DATA_STATE",
                new common.data_state_t { timestamp = Clock.Timestamp, module = Name, state = (sbyte) State });
        }

        Active Find(int number, string subject)
        {
            return faults.Find(fault => fault.Number == number && fault.Subject == subject);
        }

        /// <summary>Publishes the active faults, before the report of the same moment, so that its subject is
        /// known.</summary>
        void List(long now)
        {
            faults.Sort((a, b) => a.Number != b.Number ? a.Number.CompareTo(b.Number)
                : string.CompareOrdinal(a.Subject, b.Subject));
            var listed = faults.Select(active => new common.fault_t { number = active.Number,
                subject = Clipped(active.Subject), severity = (sbyte) active.Severity, since = active.Since,
                message = Clipped(active.Message) });
            Publish("CM_DATA_FAULTS", new common.data_faults_t { timestamp = now, module = Name, count = faults.Count,
                faults = listed.ToArray() });
        }

        void Report(int number, Kind kind, Severity severity, string text, long now, bool fatal, string file, int line)
        {
            Publish("CM_EVENT_ERROR", new common.error_t { timestamp = now, module = Name, number = number,
                message = text, fatal = fatal, type = (sbyte) kind, severity = (sbyte) severity,
                file = Path.GetFileName(file), line = line });
        }

        /// <summary>The text, truncated to the maximum length in a list.</summary>
        internal static string Clipped(string text)
        {
            byte[] bytes = Encoding.UTF8.GetBytes(text.Replace('\0', ' '));
            int length = Math.Min(bytes.Length, TextMax);
            while (length < bytes.Length && (bytes[length] & 0xc0) == 0x80) // no half a character
                --length;
            return Encoding.UTF8.GetString(bytes, 0, length);
        }

        internal static string Wire(State state) { return state.ToString().ToUpperInvariant(); }
    }
}
