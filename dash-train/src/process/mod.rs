//! The process: what a program sets up before it trains or renders, the memory it has taken, the programs that it runs,
//! and how it stops.
//!
//! | file | what |
//! | --- | --- |
//! | `children.rs` | programs that run for this one |
//! | `stop.rs` | signals that ask it to stop |

mod children;
pub mod stop;

pub(crate) use children::Child;

/// Prepares the process for training and rendering: call it first in `main`.
///
/// The allocator keeps what is freed. A training step takes and returns gradients as large as the hash tables, and
/// clearing their pages anew each time can cost more than the step. Where Linux runs without a session, Mesa's
/// layer for choosing among GPUs is left out: it writes an error about that to stderr whenever GPUs are looked for.
///
/// Both change what all threads share, so nothing happens once there is a second thread, nor on other systems
/// than Linux; the allocator changes only where it is glibc's.
pub fn prepare() {
    #[cfg(target_os = "linux")]
    if is_alone() {
        #[cfg(target_env = "gnu")]
        keep_freed_memory();
        quieten_vulkan();
    }
}

/// Prepares the process with [`prepare`] and does `work` on a thread of rayon's pool: from outside, every parallel
/// loop would wake such a thread and wait for it. Call it first in `main`.
pub fn run<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    prepare();
    rayon::scope(|_| work())
}

#[cfg(target_os = "linux")]
fn is_alone() -> bool {
    std::fs::read_dir("/proc/self/task").is_ok_and(|threads| threads.count() == 1)
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn keep_freed_memory() {
    /// Blocks above this, in bytes, still go back to the system.
    const LARGEST_KEPT: libc::c_int = 1 << 30;
    // SAFETY: `mallopt` changes parameters of the allocator, and there is no second thread.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGEST_KEPT);
        libc::mallopt(libc::M_TRIM_THRESHOLD, libc::c_int::MAX);
    }
}

#[cfg(target_os = "linux")]
fn quieten_vulkan() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: there is no second thread that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// Has [`peak_memory_bytes`] begin anew, as far as the system lets it.
pub fn reset_peak_memory() {
    // Where there is no such file, the peak is not known either.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// The most resident memory that this process has had; `None` where the system does not say.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_environment_is_left_alone_where_other_threads_run() {
        let variable = || std::env::var_os("NODEVICE_SELECT");
        let (done, wait) = std::sync::mpsc::channel::<()>();
        let other = std::thread::spawn(move || wait.recv());
        let before = variable();
        super::prepare();
        assert_eq!(variable(), before);
        drop(done);
        assert!(other.join().expect("no panic").is_err(), "nothing is sent");
    }
}
