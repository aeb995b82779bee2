use std::path::Path;

use super::*;

fn plan() -> Plan {
    let work = Work::Compare {
        methods: vec![Method::Dash, Method::WithoutDecomposition],
        had_a_say: false,
    };
    Plan::new(work, 3, None, PerceptualFiles::default())
}

#[test]
fn a_plan_has_a_task_for_each_seed_of_each_method() {
    let plan = plan();
    let runs: Vec<&str> = plan.tasks().iter().map(|task| task.run.as_str()).collect();
    let [dash, without] = ["dash", "wo-dec"];
    let expected: Vec<String> = [dash, without]
        .into_iter()
        .flat_map(|method| (0..3).map(move |seed| format!("{method}/seed-{seed}")))
        .collect();
    assert_eq!(runs, expected);
    assert_eq!(plan.of_task(0).expect("there"), (0, 0));
    assert_eq!(plan.of_task(5).expect("there"), (1, 2));
    let refused = plan.of_task(6).expect_err("there are six").to_string();
    assert!(refused.contains("from 0 to 5"), "{refused}");
}

#[test]
fn windows_wait_for_their_room() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let plan = |room| {
        let work = Work::Windows { windows: 2, room };
        Plan::new(work, 1, None, PerceptualFiles::default())
    };
    let runs =
        |plan: &Plan| -> Vec<String> { plan.tasks().iter().map(|task| task.run.clone()).collect() };
    assert_eq!(runs(&plan(false)), ["window-000", "window-001"]);
    let plan = plan(true);
    assert_eq!(runs(&plan), ["room", "window-000", "window-001"]);
    // A task that fails does not keep the others from being done, but that of the room does.
    let mut order = Vec::new();
    let failure = |number: usize| Err(Error::Config(format!("task {number}")));
    let failed = plan.work(folder.path(), Which::One(2), &|| false, &mut |number| {
        order.push(number);
        failure(number)
    });
    assert!(failed.is_err_and(|error| error.to_string().contains("task 0")));
    assert_eq!(order, [0]);
    // Whoever is told to stop while another process works on the room does so.
    let hold = Hold::take(&plan.held_path(folder.path(), 0)).expect("locks");
    let stopped = plan.work(folder.path(), Which::One(2), &|| true, &mut failure.clone());
    assert!(matches!(stopped, Err(Error::Stopped { .. })));
    drop(hold);
}

#[test]
fn plans_survive_their_file_and_damaged_ones_are_refused() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let none = Plan::read(folder.path()).expect_err("there is none");
    assert!(none.to_string().contains("dash plan"), "{none}");
    let plan = plan();
    plan.write(folder.path()).expect("writable");
    assert_eq!(Plan::read(folder.path()).expect("whole"), plan);
    let path = folder.path().join(FILE);
    let text = fs::read_to_string(&path).expect("written");
    for (from, to) in [
        ("wo-dec/seed-2", "../seed-2"),
        ("\"seeds\": 3", "\"seeds\": 2"),
        ("\"seeds\": 3", "\"seeds\": 18446744073709551615"),
        ("\"format_version\": 1", "\"format_version\": 2"),
        ("\"memory\"", "\"memories\""),
    ] {
        assert!(text.contains(from), "{from}");
        fs::write(&path, text.replace(from, to)).expect("writable");
        let refused = Plan::read(folder.path()).expect_err(to).to_string();
        assert!(refused.contains("plan.json"), "{refused}");
    }
    fs::write(&path, &text[..text.len() / 2]).expect("writable");
    assert!(Plan::read(folder.path()).is_err());
}

#[test]
fn what_is_missing_is_told_until_it_is_scored() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let plan = plan();
    let missing = plan.missing(folder.path()).expect("readable");
    assert_eq!((missing.len(), missing[0]), (6, "dash/seed-0"));
    // A run that has begun is not done.
    let run = plan.run_path(folder.path(), 1);
    fs::create_dir_all(&run).expect("writable");
    fs::write(run.join("config.toml"), "").expect("writable");
    assert!(!plan.is_done(folder.path(), 1).expect("readable"));
    fs::write(run.join("results.json"), "{").expect("writable");
    assert!(plan.is_done(folder.path(), 1).is_err());
}

#[test]
fn what_one_holds_no_other_can_until_it_lets_go() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = plan().held_path(folder.path(), 5);
    let hold = Hold::take(&path).expect("locks").expect("nobody has it");
    assert!(Hold::take(&path).expect("locks").is_none());
    let other = plan().held_path(folder.path(), 4);
    assert!(Hold::take(&other).expect("locks").is_some());
    // Whoever waits has it once it is let go, and no longer waits when told to stop.
    let mut told = 0;
    let stopped = Hold::wait(&path, &|| false, || drop(hold)).expect("locks");
    assert!(stopped.is_some());
    assert!(
        Hold::wait(&path, &|| true, || told += 1)
            .expect("locks")
            .is_none()
    );
    assert_eq!(told, 0);
}

#[test]
fn schedulers_are_given_each_task_and_paths_that_shells_and_yaml_read() {
    let out = Path::new("/data/it's here");
    let program = Path::new("/opt/dash");
    let text = script(Engine::Slurm, program, out, 12, false);
    for line in [
        "--requeue --signal=TERM@120",
        r#"tasks=$(queue --array=0-11 "$@")"#,
        r#"srun /opt/dash work '/data/it'\''s here' --task "$SLURM_ARRAY_TASK_ID""#,
        r"exec /opt/dash join '/data/it'\''s here'",
        r#"--dependency="afterany:${tasks%%;*}""#,
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
    let text = script(Engine::Slurm, program, out, 12, true);
    for line in [
        r#"first=$(queue --array=0 "$@")"#,
        r#"tasks=$(queue --array=1-11 --dependency="afterok:${first%%;*}""#,
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
    let text = script(
        Engine::Kubernetes,
        program,
        Path::new("/data/runs/all"),
        12,
        true,
    );
    for line in [
        "completions: 12\n",
        r#"command: [sh, -c, "exec dash work /data/runs/all --task \"$JOB_COMPLETION_INDEX\""]"#,
        r#"mountPath: "/data/runs""#,
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}

#[test]
fn what_killed_processes_left_is_removed_where_nobody_works_on_it() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let out = folder.path();
    let plan = plan();
    let run = plan.run_path(out, 1);
    let left = [
        out.join(".plan.json.partial"),
        run.join(".checkpoints.partial"),
        run.join("checkpoints/000010"),
    ];
    for path in &left {
        fs::create_dir_all(path).expect("writable");
    }
    fs::write(run.join("config.toml"), "").expect("writable");
    // Whoever scored it may not be at its end.
    let hold = Hold::take(&plan.held_path(out, 1)).expect("locks");
    Plan::tidy(out).expect("removed");
    plan.tidy_done(out, 1).expect("left");
    assert_eq!(left.clone().map(|path| path.exists()), [false, true, true]);
    drop(hold);
    plan.tidy_done(out, 1).expect("removed");
    assert_eq!(left.map(|path| path.exists()), [false; 3]);
}
