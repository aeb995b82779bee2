//! Scripts that have a cluster's own scheduler do the tasks of a plan.

use std::path::Path;

/// Seconds before a task's time is up at which Slurm tells it, and that Kubernetes waits for it: time for a checkpoint.
const NOTICE_SECS: u32 = 120;
/// How often a task that was killed is tried again.
const RETRIES: u32 = 10;

/// A scheduler.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Engine {
    /// A job array, and a job that joins after it.
    Slurm,
    /// An Indexed Job.
    Kubernetes,
}

/// What has `engine` do the `n` tasks of the plan in `out` with `program`, which nodes of a Slurm cluster find there, too; where
/// the others need the first one, after that. Both paths are absolute.
pub fn script(engine: Engine, program: &Path, out: &Path, n: usize, needs_first: bool) -> String {
    let out = out.display().to_string();
    match engine {
        Engine::Slurm => {
            let program = quoted(&program.display().to_string());
            slurm(&program, &out, n, needs_first)
        }
        Engine::Kubernetes => kubernetes(&out, n),
    }
}

/// A shell script. Options of `sbatch` are its arguments.
fn slurm(program: &str, out: &str, n: usize, needs_first: bool) -> String {
    let last = n.saturating_sub(1);
    let [folder, log, join_log] =
        ["", "/task-%a.log", "/join.log"].map(|file| quoted(&format!("{out}{file}")));
    let queued = match needs_first && last > 0 {
        false => format!(r#"tasks=$(queue --array=0-{last} "$@")"#),
        true => format!(
            r#"# All others need the first.
first=$(queue --array=0 "$@")
tasks=$(queue --array=1-{last} --dependency="afterok:${{first%%;*}}" --kill-on-invalid-dep=yes "$@")"#
        ),
    };
    format!(
        r#"#!/bin/sh
# Has Slurm do the {n} tasks of a plan, then join them. Arguments go to sbatch, such as --partition=gpu --gres=gpu:1.
# A task that is stopped or killed is queued again, up to {RETRIES} times, and goes on from its newest checkpoint.
set -eu
queue() {{
    sbatch --parsable --job-name=dash --requeue --signal=TERM@{NOTICE_SECS} --open-mode=append --output={log} "$@" <<'JOB'
#!/bin/sh
srun {program} work {folder} --task "$SLURM_ARRAY_TASK_ID"
code=$?
[ "$code" -lt 128 ] || [ "${{SLURM_RESTART_COUNT:-0}}" -ge {RETRIES} ] || exec scontrol requeue "$SLURM_JOB_ID"
exit "$code"
JOB
}}
{queued}
sbatch --job-name=dash-join --dependency="afterany:${{tasks%%;*}}" --output={join_log} "$@" <<'JOB'
#!/bin/sh
exec {program} join {folder}
JOB"#
    )
}

/// A manifest.
fn kubernetes(out: &str, n: usize) -> String {
    let parent = Path::new(out).parent().unwrap_or(Path::new("/"));
    let mount = yaml(&parent.display().to_string());
    let command = yaml(&format!(
        "exec dash work {} --task \"$JOB_COMPLETION_INDEX\"",
        quoted(out)
    ));
    let version = env!("CARGO_PKG_VERSION");
    let join = quoted(out);
    format!(
        r#"# The {n} tasks of a plan as an Indexed Job. Change the lines that say so, and then:
#   kubectl apply -f tasks.yaml
#   kubectl wait --for=condition=complete --timeout=-1s job/dash-tasks
#   dash join {join}
apiVersion: batch/v1
kind: Job
metadata:
  name: dash-tasks
spec:
  completionMode: Indexed
  completions: {n}
  parallelism: {n} # change: tasks at once
  backoffLimitPerIndex: {RETRIES}
  template:
    spec:
      restartPolicy: Never
      terminationGracePeriodSeconds: {NOTICE_SECS}
      containers:
        - name: dash
          image: dash:{version} # change: an image that holds the program
          command: [sh, -c, {command}]
          resources: # change: what a task needs
            requests:
              cpu: "2"
              memory: 8Gi
          volumeMounts:
            - name: shared
              mountPath: {mount} # change: a folder that holds the plan and the data
      volumes:
        - name: shared
          persistentVolumeClaim:
            claimName: shared # change: that folder's claim"#
    )
}

/// A word of a shell.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-%+=:,@".contains(c);
    match word.chars().all(is_plain) && !word.is_empty() {
        true => word.to_string(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

/// A string of YAML, of which JSON's are a part.
fn yaml(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
