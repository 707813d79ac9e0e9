//! Shell commands as modules.

use super::*;
use crate::clock;
use std::path::Path;
use std::thread::sleep;

/// Starts this program, whatever module is requested.
fn launch(program: &'static str, args: Vec<&'static str>, run_dir: Option<&Path>) -> Launch {
    let start = move |_: &str, _| {
        let mut command = Command::new(program);
        command.args(&args);
        Start {
            command,
            limits: Limits::default(),
            capabilities: &[],
            foreign: false,
            lines_from: LinesFrom::default(),
            keeper: None,
        }
    };
    Launch {
        start: Box::new(start),
        run_dir: run_dir.map(Into::into),
        divides: false,
        rt_priority: None,
        notices: Vec::new(),
    }
}

fn shell(script: &'static str, run_dir: Option<&Path>) -> Launch {
    launch("/bin/sh", vec!["-c", script], run_dir)
}

/// Runs `script` in a shell and waits for the start.
fn start(script: &'static str) -> (Processes, u32) {
    let mut processes = Processes::new(clock::now(), shell(script, None), None).unwrap();
    let spawn = ProcessCommand::Spawn { module: "m".into(), wanted: State::Run };
    processes.command(spawn);
    let started = start_result(&mut processes).unwrap();
    (processes, started)
}

/// Waits up to 5 s for the result of a start: its pid, or the reason of the failure.
fn start_result(processes: &mut Processes) -> Result<u32, String> {
    for _ in 0..1000 {
        processes.on_ends();
        let mut start_result = None;
        processes.poll_event(|event| match event {
            ProcessEvent::Started { module: "m", pid } => start_result = Some(Ok(pid)),
            ProcessEvent::Unstartable { module: "m", reason } => start_result = Some(Err(reason.into())),
            other => panic!("{other:?}"),
        });
        if let Some(start_result) = start_result {
            return start_result;
        }
        sleep(std::time::Duration::from_millis(5));
    }
    panic!("it does not begin");
}

/// Waits up to 5 s for the end of the one process.
fn end(processes: &mut Processes) -> ExitStatus {
    for _ in 0..500 {
        processes.on_ends();
        let mut status = None;
        processes.poll_event(|event| match event {
            ProcessEvent::Exited { status: how, .. } => status = Some(how),
            other => panic!("{other:?}"),
        });
        if let Some(status) = status {
            return status;
        }
        sleep(std::time::Duration::from_millis(10));
    }
    panic!("it does not end");
}

fn gone(pid: u32) -> bool {
    // An orphan may stay a zombie if no process reaps it.
    fs::read_to_string(format!("/proc/{pid}/stat")).map_or(true, |stat| stat.contains(") Z "))
}

#[test]
fn an_exit_code_is_reported() {
    let (mut processes, _) = start("exit 32");
    assert_eq!(end(&mut processes), ExitStatus::Code(32));
}

#[test]
fn terminate_ends_the_whole_group() {
    let dir = std::env::temp_dir().join(format!("advee-group-{}", std::process::id()));
    let path = dir.display().to_string();
    // The shell waits for a child of its own; both get the signal.
    let script: &'static str = format!("sleep 100 & echo $! > {path}.new; mv {path}.new {path}; wait").leak();
    let (mut processes, pid) = start(script);
    let child = loop {
        match fs::read_to_string(&dir) {
            Ok(text) => break text.trim().parse().unwrap(),
            Err(_) => sleep(std::time::Duration::from_millis(5)),
        }
    };
    fs::remove_file(&dir).unwrap();
    processes.command(ProcessCommand::Terminate { pid });
    assert_eq!(end(&mut processes), ExitStatus::Signal(15));
    for _ in 0..500 {
        if gone(child) {
            return;
        }
        sleep(std::time::Duration::from_millis(10));
    }
    panic!("{child} is left over");
}

#[test]
fn processes_left_in_a_group_are_killed() {
    let dir = std::env::temp_dir().join(format!("advee-orphan-{}", std::process::id()));
    let path = dir.display().to_string();
    let script: &'static str = format!("trap '' TERM; sleep 100 & echo $! > {path}").leak();
    let (mut processes, _) = start(script);
    assert_eq!(end(&mut processes), ExitStatus::Code(0));
    let child = fs::read_to_string(&dir).unwrap().trim().parse().unwrap();
    fs::remove_file(&dir).unwrap();
    for _ in 0..500 {
        if gone(child) {
            return;
        }
        sleep(std::time::Duration::from_millis(10));
    }
    panic!("{child} is left over");
}

#[test]
fn a_foreign_pid_is_ignored() {
    let (mut processes, pid) = start("sleep 100");
    // The pid of this test, which would not survive the signal.
    processes.command(ProcessCommand::Kill { pid: std::process::id() });
    processes.command(ProcessCommand::Kill { pid });
    assert_eq!(end(&mut processes), ExitStatus::Signal(9));
}

#[test]
fn the_load_of_a_process_is_measured() {
    let (mut processes, pid) = start("while :; do :; done");
    assert!(Path::new(&format!("/proc/{pid}")).exists());
    sleep(std::time::Duration::from_millis(1100));
    processes.handle_timeout(clock::now());
    let mut used = (0.0, 0);
    assert!(processes.poll_event(|event| match event {
        ProcessEvent::Usage { cpu, rss, .. } => used = (cpu, rss),
        other => panic!("{other:?}"),
    }));
    processes.command(ProcessCommand::Kill { pid });
    end(&mut processes);
    assert!(used.0 > 0.05 && used.0 < 1.5 && used.1 > 10_000, "{used:?}");
}

#[test]
fn heartbeats_are_checked_when_the_watchdog_is_awake_anyway() {
    let processes = Processes::new(Instant::from_millis(5007), launch("/bin/true", Vec::new(), None), None).unwrap();
    assert_eq!(processes.looks.next(), Instant::from_millis(5020));
}

#[test]
fn a_missing_command_is_reported() {
    let launch = launch("/nonexistent/module", Vec::new(), None);
    let mut processes = Processes::new(clock::now(), launch, None).unwrap();
    let spawn = ProcessCommand::Spawn { module: "m".into(), wanted: State::Run };
    processes.command(spawn);
    let reported = start_result(&mut processes).unwrap_err();
    assert_eq!(reported, "/nonexistent/module: No such file or directory (os error 2)");
}

/// A run folder for one test.
struct Run(PathBuf);

impl Run {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("advee-adopt-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// The processes of a watchdog in this folder, and the earlier ones reported to it: pid and wanted state.
    fn life(&self, script: &'static str) -> (Processes, Vec<(Option<u32>, State)>) {
        let mut processes = Processes::new(clock::now(), shell(script, Some(&self.0)), None).unwrap();
        let mut reported = Vec::new();
        while processes.poll_event(|event| match event {
            ProcessEvent::Earlier { pid, wanted, .. } => reported.push((pid, wanted)),
            other => panic!("{other:?}"),
        }) {}
        (processes, reported)
    }

    fn spawn(processes: &mut Processes) -> u32 {
        processes.command(ProcessCommand::Spawn { module: "m".into(), wanted: State::Run });
        start_result(processes).unwrap()
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        clean(&self.0);
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn a_process_of_an_earlier_watchdog_is_adopted_and_its_end_is_seen() {
    let run = Run::new("adopted");
    let (mut first, reported) = run.life("exec sleep 100");
    assert_eq!(reported, []);
    let pid = Run::spawn(&mut first);
    first.command(ProcessCommand::Remember { module: "m".into(), wanted: State::Stop, held: false });
    // The watchdog is killed, without any cleanup.
    let child = first.running.remove(0).child.unwrap();
    drop(first);

    let (mut second, reported) = run.life("exec sleep 100");
    assert_eq!(reported, [(Some(pid), State::Stop)]);
    second.on_ends();
    assert!(second.news.is_empty(), "it lives");
    second.command(ProcessCommand::Kill { pid });
    // This test is the real parent and reaps it late.
    assert_eq!(end(&mut second), ExitStatus::Signal(9));
    drop(child);
    let (_, reported) = run.life("exec sleep 100");
    assert_eq!(reported, [(None, State::Stop)], "the wanted state outlives the process");
}

#[test]
fn an_adopted_process_and_all_that_it_started_get_a_signal() {
    let run = Run::new("group");
    let file = run.0.join("pid");
    let script: &'static str = format!("sleep 100 & echo $! > {0}.new; mv {0}.new {0}; wait", file.display()).leak();
    let (mut first, _) = run.life(script);
    let pid = Run::spawn(&mut first);
    let within = loop {
        match fs::read_to_string(&file) {
            Ok(text) => break text.trim().parse().unwrap(),
            Err(_) => sleep(std::time::Duration::from_millis(5)),
        }
    };
    let child = first.running.remove(0).child.unwrap();
    drop(first);
    let (mut second, reported) = run.life(script);
    assert_eq!(reported, [(Some(pid), State::Run)]);
    second.command(ProcessCommand::Terminate { pid });
    assert_eq!(end(&mut second), ExitStatus::Signal(15));
    drop(child);
    for _ in 0..500 {
        if gone(within) {
            return;
        }
        sleep(std::time::Duration::from_millis(10));
    }
    panic!("{within} is left over");
}

#[test]
fn a_page_that_an_adopting_watchdog_cannot_open_is_reported() {
    let run = Run::new("unread");
    let (mut first, _) = run.life("exec sleep 100");
    let pid = Run::spawn(&mut first);
    let mut child = first.running.remove(0).child.unwrap();
    drop(first);
    let folder = run.0.join("beats");
    fs::create_dir(&folder).unwrap();
    let launch = shell("exec sleep 100", Some(&run.0));
    let mut second = Processes::new(clock::now(), launch, Some(folder)).unwrap();
    let mut told = Vec::new();
    while second.poll_event(|event| told.push(format!("{event:?}"))) {}
    assert!(told[0].starts_with("Earlier") && told[0].contains(&pid.to_string()), "{told:?}");
    assert!(told[1].starts_with("BadHeartbeat") && told[1].contains("cannot be opened"), "{told:?}");
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_record_that_cannot_be_written_at_adoption_is_reported() {
    let run = Run::new("unwritable");
    let (mut first, _) = run.life("exec sleep 100");
    Run::spawn(&mut first);
    let mut child = first.running.remove(0).child.unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    drop(first);
    // A folder in place of the file that would replace the record.
    fs::create_dir(run.0.join(RECORD).with_extension("new")).unwrap();
    let (mut second, reported) = run.life("exec sleep 100");
    assert_eq!(reported, [(None, State::Run)]);
    let told = second.poll_note().unwrap();
    assert!(told.contains("will not adopt these processes"), "{told}");
}

#[test]
fn a_process_without_a_recorded_pid_is_found() {
    let run = Run::new("starting");
    let (mut first, _) = run.life("exec sleep 100");
    let pid = Run::spawn(&mut first);
    first.record_entry("m", |entry| (entry.process, entry.starting) = (None, true));
    let _child = first.running.remove(0).child;
    let (mut second, reported) = run.life("exec sleep 100");
    assert_eq!(reported, [(Some(pid), State::Run)]);
    second.command(ProcessCommand::Kill { pid });
    end(&mut second);
}

#[test]
fn a_process_with_another_command_line_is_ended() {
    let run = Run::new("otherwise");
    let (mut first, _) = run.life("exec sleep 100");
    Run::spawn(&mut first);
    let mut child = first.running.remove(0).child.unwrap();
    let (_second, reported) = run.life("exec sleep 200");
    assert_eq!(reported, [(None, State::Run)]);
    assert_eq!(child.wait().unwrap().signal(), Some(9));
}

#[test]
fn a_reused_pid_is_not_touched() {
    let run = Run::new("stale");
    let (first, _) = run.life("exit 0");
    let as_started = (first.launch.start)("m", State::Run).command;
    let mark = identity::mark(first.record.as_ref().unwrap().path(), "m", &as_started);
    let bystander = |marked: bool| {
        let mut command = Command::new("sleep");
        command.arg("100").process_group(0);
        if marked {
            command.env(VARIABLE, &mark);
        }
        command.spawn().unwrap()
    };
    let mut of_another_start = bystander(true);
    let mut unmarked = bystander(false);
    let start = |child: &Child| Stat::of(child.id()).unwrap().start;
    let record = |child: &Child, start: u64| {
        let (mut life, _) = run.life("exit 0");
        life.record_entry("m", |entry| entry.process = Some((child.id(), start)));
    };
    for (child, start) in [(&of_another_start, start(&of_another_start) + 1), (&unmarked, start(&unmarked))] {
        record(child, start);
        let (mut next, reported) = run.life("exit 0");
        assert_eq!(reported, [(None, State::Run)]);
        next.command(ProcessCommand::Kill { pid: child.id() });
    }
    // With the right start time it is adopted.
    record(&of_another_start, start(&of_another_start));
    assert_eq!(run.life("exit 0").1, [(Some(of_another_start.id()), State::Run)]);
    for child in [&mut of_another_start, &mut unmarked] {
        assert_eq!(child.try_wait().unwrap(), None, "it was left alone");
        child.kill().unwrap();
        child.wait().unwrap();
    }
}

#[test]
fn processes_outside_the_group_end_with_the_cgroup() {
    let run = Run::new("cgroup");
    let file = run.0.join("pid");
    let script = format!("setsid sleep 100 & echo $! > {0}.new; mv {0}.new {0}; wait", file.display());
    let (mut processes, _) = run.life(script.leak());
    if processes.groups.is_none() {
        testing::machine_or_skip::<()>(Err("no cgroup v2 folder that may be written".into()));
        return;
    }
    let pid = Run::spawn(&mut processes);
    let escaped = loop {
        match fs::read_to_string(&file) {
            Ok(text) => break text.trim().parse().unwrap(),
            Err(_) => sleep(std::time::Duration::from_millis(5)),
        }
    };
    processes.command(ProcessCommand::Kill { pid });
    assert_eq!(end(&mut processes), ExitStatus::Signal(9));
    for _ in 0..500 {
        if gone(escaped) {
            return;
        }
        sleep(std::time::Duration::from_millis(10));
    }
    panic!("{escaped} is left over");
}

#[test]
fn a_foreign_module_s_lines_are_read_until_its_end_and_by_the_next_watchdog() {
    let dir = std::env::temp_dir().join(format!("advee-lines-{}", std::process::id()));
    fs::create_dir_all(&dir).unwrap();
    let go = dir.join("go").display().to_string();
    let script: &'static str =
        format!("echo one >&2; while [ ! -e {go} ]; do sleep 0.01; done; echo '<4>two' >&2; printf half >&2").leak();
    let from = LinesFrom { print: Level::Error, send: Level::Debug };
    let launch = || {
        let start = move |_: &str, _| {
            let mut command = Command::new("/bin/sh");
            command.args(["-c", script]);
            Start {
                command,
                limits: Limits::default(),
                capabilities: &[],
                foreign: true,
                lines_from: from,
                keeper: None,
            }
        };
        Launch {
            start: Box::new(start),
            run_dir: Some(dir.clone()),
            divides: false,
            rt_priority: None,
            notices: Vec::new(),
        }
    };
    let line = |level, text: &str| Line { module: "m".into(), level, text: text.into(), from };
    let mut first = Processes::new(clock::now(), launch(), None).unwrap();
    first.command(ProcessCommand::Spawn { module: "m".into(), wanted: State::Run });
    start_result(&mut first).unwrap();
    let said = (0..500).find_map(|_| {
        sleep(std::time::Duration::from_millis(10));
        first.handle_timeout(clock::now());
        first.poll_line()
    });
    assert_eq!(said, Some(line(Level::Info, "one")));
    let mut second = Processes::new(clock::now(), launch(), None).unwrap();
    assert!(second.poll_event(|news| assert!(matches!(news, ProcessEvent::Earlier { pid: Some(_), .. }), "{news:?}")));
    fs::write(dir.join("go"), "").unwrap();
    end(&mut second);
    assert_eq!(second.poll_line(), Some(line(Level::Warning, "two")));
    assert_eq!(second.poll_line(), Some(line(Level::Info, "half")));
    assert_eq!(second.poll_line(), None);
    clean(&dir);
    assert!(!dir.join("stderr").exists());
    fs::remove_dir_all(&dir).unwrap();
}
