//! What a module is: events in, actions out; states, commands, reports.
