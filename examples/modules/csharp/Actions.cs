// Actions that a module in C# offers: HL_CMD_ACTION and HL_DATA_ACTION (docs/highlevel.md); actions.py in C#.
//
//     sealed class Greeter : Performer
//     {
//         Greeter(Options options) : base(options)
//         {
//             Offer("greet", greeting => greeting.Succeed("greeted " + greeting.Text("name")));
//             Every(0.1, Working); // it needs no device
//         }
//     }
//
// The helper answers each command, rejects those beyond the limits and those that come while the module is not in RUN,
// repeats the status each second, knows repeated commands by their id, and fails what is under way when the module
// leaves RUN. All calls come from the module's loop, and all methods are called from it.
using System;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;
using System.Text;
using System.Text.RegularExpressions;
using highlevel;

namespace Advee
{
    /// <summary>Statuses of an action, by their values on the wire.</summary>
    public enum Status : sbyte { Accepted, Running, Succeeded, Failed, Cancelled, Rejected }

    /// <summary>To be thrown when an action is about to begin: it is rejected, with this reason.</summary>
    public sealed class RejectedException : Exception
    {
        public RejectedException(string reason) : base(reason) { }
    }

    /// <summary>An action that was commanded.</summary>
    public sealed class Performance
    {
        const double Again = 0.1; // s at least between two statuses that differ in the progress alone
        const int Times = 3;      // times that an end is published

        readonly Performer performer;
        Status status = Status.Accepted;
        double progress = double.NaN, published = double.NegativeInfinity;
        string message = "";

        /// <summary>Its id, and the name of the action.</summary>
        public readonly string Id, Name;

        internal readonly Dictionary<string, string> Parameters = new Dictionary<string, string>();
        internal string Lost;
        internal bool Cancelling;
        internal int Ends; // times that its end is still published

        internal Performance(Performer performer, cmd_action_t command)
        {
            this.performer = performer;
            Id = command.id;
            Name = command.name;
        }

        /// <summary>True once it has ended.</summary>
        public bool Over { get { return status >= Status.Succeeded; } }

        /// <summary>Returns a parameter, or the default; without both the action is rejected.</summary>
        public string Text(string key, string otherwise = null)
        {
            string value;
            if (!Parameters.TryGetValue(key, out value))
                value = otherwise;
            if (value == null)
                throw new RejectedException("parameter " + key + " is missing");
            return value;
        }

        /// <summary>Returns a parameter as a number from low to high, else the action is rejected; a default needs no
        /// limits.</summary>
        public double Number(string key, double low, double high, double? otherwise = null)
        {
            if (otherwise.HasValue && !Parameters.ContainsKey(key))
                return otherwise.Value;
            double number;
            if (!double.TryParse(Text(key), NumberStyles.Float, CultureInfo.InvariantCulture, out number)
                || !(number >= low && number <= high))
                throw new RejectedException("parameter " + key + " is no number from " + Brief(low) + " to "
                    + Brief(high));
            return number;
        }

        /// <summary>A number as people write it: 600 and 0.1.</summary>
        public static string Brief(double number)
        {
            return number.ToString("G6", CultureInfo.InvariantCulture);
        }

        /// <summary>Reports that it is under way: progress 0 to 1, or NaN if that is not known; what is done
        /// now.</summary>
        public void Run(double progress = double.NaN, string message = "")
        {
            Change(Status.Running, progress, message);
        }

        /// <summary>Ends it: it has reached its aim.</summary>
        public void Succeed(string message = "") { Change(Status.Succeeded, 1, message); }

        /// <summary>Ends it: it has not reached its aim, for this reason.</summary>
        public void Fail(string message) { Change(Status.Failed, progress, message); }

        /// <summary>Ends it because it was cancelled; as Failed where that was because the module left Run.</summary>
        public void Cancelled(string message = "")
        {
            if (Lost == null)
                Change(Status.Cancelled, progress, message);
            else
                Fail(Lost);
        }

        /// <summary>Rejects it; after its start it has failed.</summary>
        internal void Reject(string reason)
        {
            Change(status == Status.Accepted ? Status.Rejected : Status.Failed, progress, reason);
        }

        internal bool IsPublished { get { return !double.IsNegativeInfinity(published); } }

        /// <summary>Changes the status. After the end nothing changes; a new progress alone is not published too
        /// often.</summary>
        void Change(Status to, double share, string text)
        {
            if (Over)
                return;
            bool news = status != to || message != text;
            status = to;
            message = text;
            progress = share >= 0 && share <= 1 ? share : double.NaN;
            if (news)
                Publish();
            else
                Answer();
            if (Over)
            {
                Ends = Times - 1;
                performer.OnEnd(this);
            }
        }

        /// <summary>Publishes the status, unless that was just done.</summary>
        internal void Answer()
        {
            if (Clock.Now - published >= Again)
                Publish();
        }

        internal void Publish()
        {
            published = Clock.Now;
            performer.Publish("HL_DATA_ACTION", new data_action_t { timestamp = Clock.Timestamp, id = Id,
                status = (sbyte) status, progress = progress, message = Module.Clipped(message) });
        }
    }

    /// <summary>A module that offers actions: call Offer() in the constructor.</summary>
    public abstract class Performer : Module
    {
        static readonly Regex id = new Regex(@"\A[!-~]{1,128}\z"), name = new Regex(@"\A[A-Za-z][A-Za-z0-9_.-]{0,63}\z");

        const double Period = 1.0;    // s between two statuses of an action that lasts
        const int ParametersMax = 32; // parameters of a command
        const int ValueMax = 4096;    // bytes of a value
        const int UnderWayMax = 16;   // actions at a time; further ones are rejected
        const int EndedMax = 64;      // actions that have ended and are known by their id

        sealed class Offered
        {
            public Action<Performance> Begin, Cancel;
        }

        readonly Dictionary<string, Offered> offers = new Dictionary<string, Offered>();
        readonly List<Performance> underWay = new List<Performance>();
        readonly Queue<Performance> ended = new Queue<Performance>();

        protected Performer(Options options) : base(options)
        {
            Subscribe<cmd_action_t>("HL_CMD_ACTION", OnAction);
            Every(Period, Repeat);
        }

        /// <summary>Offers the action of this name. Begin is called for each one, in Run: it starts the work, or throws
        /// RejectedException, and returns quickly; Run() reports progress, Succeed(), Fail() or Cancelled() its end,
        /// then or later. Cancel is called once when it is cancelled, and when the module leaves Run: what is under way
        /// is stopped, and Cancelled() called as soon as it is; without it that is at once.</summary>
        protected void Offer(string action, Action<Performance> begin, Action<Performance> cancel = null)
        {
            if (!name.IsMatch(action))
                throw new ArgumentException(action + " is no name of an action");
            offers[action] = new Offered { Begin = begin, Cancel = cancel };
        }

        /// <summary>The actions under way, in the order of their commands.</summary>
        protected IEnumerable<Performance> Actions { get { return underWay.ToArray(); } }

        void OnAction(cmd_action_t command)
        {
            if (!id.IsMatch(command.id))
            {
                Fault(MessageMalformed, Kind.Unknown, Severity.Warning,
                    "HL_CMD_ACTION: a command without a valid id is dropped", "HL_CMD_ACTION");
                return;
            }
            Performance known = underWay.Concat(ended).FirstOrDefault(action => action.Id == command.id);
            if (known != null)
            {
                if (command.cancel && !known.Over)
                    Cancel(known);
                known.Answer();
            }
            else if (offers.ContainsKey(command.name))
                Begin(new Performance(this, command), command);
        }

        void Begin(Performance action, cmd_action_t command)
        {
            underWay.Add(action);
            if (command.cancel)
            {
                action.Cancelled("it was not under way");
                return;
            }
            string reason = Objection(command);
            if (reason != null)
            {
                action.Reject(reason);
                return;
            }
            foreach (parameter_t parameter in command.parameters)
                action.Parameters[parameter.name] = parameter.value;
            try
            {
                offers[action.Name].Begin(action);
            }
            catch (RejectedException rejected)
            {
                action.Reject(rejected.Message);
            }
            if (!action.IsPublished) // its work has begun without a report
                action.Publish();
        }

        /// <summary>The reason for which a command is rejected; null if it is accepted.</summary>
        string Objection(cmd_action_t command)
        {
            if (!Acts)
                return Name + " is in " + Wire(State);
            if (underWay.Count > UnderWayMax)
                return Name + " has " + UnderWayMax + " actions under way";
            if (command.count > ParametersMax)
                return command.count + " parameters are more than " + ParametersMax;
            var names = new HashSet<string>();
            if (!command.parameters.All(parameter => name.IsMatch(parameter.name) && names.Add(parameter.name)))
                return "a parameter has no valid name, or that of another one";
            if (command.parameters.Any(parameter => Encoding.UTF8.GetByteCount(parameter.value) > ValueMax))
                return "the value of a parameter has more than " + ValueMax + " bytes";
            return null;
        }

        void Cancel(Performance action)
        {
            if (action.Cancelling)
                return;
            action.Cancelling = true;
            Action<Performance> cancel = offers[action.Name].Cancel;
            if (cancel == null)
                action.Cancelled();
            else
                cancel(action);
        }

        /// <summary>Keeps an action that has ended, instead of the oldest one.</summary>
        internal void OnEnd(Performance action)
        {
            underWay.Remove(action);
            action.Parameters.Clear();
            ended.Enqueue(action);
            if (ended.Count > EndedMax)
                ended.Dequeue();
        }

        void Repeat()
        {
            foreach (Performance action in underWay)
                action.Publish();
            foreach (Performance action in ended.Where(action => action.Ends > 0))
            {
                --action.Ends;
                action.Publish();
            }
        }

        /// <summary>When the module leaves Run, what is under way has failed.</summary>
        internal override void BeforeState(State to)
        {
            if (to == State.Run)
                return;
            foreach (Performance action in Actions)
            {
                action.Lost = Name + " is in " + Wire(to);
                Cancel(action);
                action.Cancelled();
            }
        }
    }
}
