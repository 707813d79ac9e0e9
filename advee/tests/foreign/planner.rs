//! The planner of `examples/planner` in place of the built-in one, under the watchdog of the simulated robot.

use crate::built::Built;
use crate::support::{Robot, undisturbed, workspace};
use std::fs;
use std::path::Path;

#[test]
fn a_planner_in_python_drives_to_a_goal_and_the_guard_stops_it_before_a_wall() {
    let Some(built) = Built::on_the_wheel() else { return };
    undisturbed(|| {
        let config = std::env::temp_dir().join(format!("advee-planner-{}", std::process::id()));
        configure(built, &config);
        let folder = config.join("advee");
        let folder = folder.to_str().expect("UTF-8");
        let start = "world.start=[14.5, 6.0, 0.0]";
        let mut robot = Robot::start(&["--config", folder, "--world", "empty", "--set", start]);
        drives(&mut robot);
        assert_eq!(robot.stop(), 0);
        fs::remove_dir_all(&config).expect("its own folder");
    });
}

fn drives(robot: &mut Robot) {
    let goal = |robot: &Robot, at: &str| {
        let output = robot.advee(&["goal", at, "--when-ready"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    goal(robot, "17,6");
    robot.until("the first goal", 60.0, |view| view.truth.as_ref().is_some_and(|truth| truth.x > 16.5));
    robot.until("its end", 10.0, |view| view.speed().abs() < 0.01);
    let line = fs::read(format!("/proc/{}/cmdline", robot.view.pid("planner"))).expect("it runs");
    assert!(String::from_utf8_lossy(&line).contains("planner.py"), "it was this planner");
    // Behind the wall at 20 m; the planner sees no obstacle in it.
    goal(robot, "24,6");
    let stands = |robot: &mut Robot| {
        robot.until("the wall", 60.0, |view| view.truth.as_ref().is_some_and(|truth| truth.x > 18.0));
        robot.until("standstill", 20.0, |view| view.speed().abs() < 0.01);
    };
    stands(robot);
    robot.pass(1.0);
    let truth = robot.view.truth.clone().expect("20 Hz");
    assert!(truth.collisions == 0 && truth.clearance > 0.0 && truth.x < 19.3, "{truth:?}");
}

/// Shipped robot with the planner of the example, which takes the robot for a point: only the guard sees the wall.
fn configure(built: &Built, config: &Path) {
    let (advee, worlds) = (config.join("advee"), config.join("worlds"));
    for (from, to) in [("conf/advee", &advee), ("conf/worlds", &worlds)] {
        fs::create_dir_all(to).expect("a folder");
        for entry in fs::read_dir(workspace().join(from)).expect("shipped") {
            let entry = entry.expect("an entry");
            fs::copy(entry.path(), to.join(entry.file_name())).expect("copied");
        }
    }
    let line = built.command(("python", "battery_watch"));
    let helpers = Path::new(&line[1]).parent().expect("it lies in a folder").display().to_string();
    let planner = workspace().join("examples/planner/planner.py").display().to_string();
    let path = format!("PYTHONPATH={helpers}");
    let args = [path.as_str(), &line[0], &planner, "--radius", "0.01", "--middle", "0"];
    let entry = format!("name = \"planner\"\ncommand = \"env\"\nargs = {args:?}\n");
    let modules = fs::read_to_string(advee.join("modules.toml")).expect("shipped");
    let replaced = modules.replace("name = \"planner\" ", &format!("{entry}#"));
    assert_ne!(replaced, modules, "the shipped list has a planner");
    fs::write(advee.join("modules.toml"), replaced).expect("written");
}
