//! Signals that ask the program to stop: Ctrl-C, `kill`, a terminal that was closed.
//!
//! A thread waits for them. It ends the programs that run for this one, removes what is unfinished, says so, and ends
//! with 128 and the signal's number. While somebody [asks](Asked) whether to stop, the first signal is theirs to answer;
//! the second ends the program all the same. There are no signals to wait for on systems that are not Unix.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// A signal that asks the program to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    number: i32,
    name: &'static str,
}

impl Signal {
    /// Its name, such as `SIGINT`.
    pub fn name(self) -> &'static str {
        self.name
    }

    /// The program's exit code: 130 of SIGINT, 143 of SIGTERM, 129 of SIGHUP.
    pub fn exit_code(self) -> u8 {
        128 + self.number as u8
    }
}

struct State {
    received: Option<Signal>,
    /// Whether somebody asks.
    asked: bool,
    /// Whether the program is being ended.
    ending: bool,
    /// How the user goes on from here.
    way_on: Option<String>,
}

static STATE: Mutex<State> = Mutex::new(State {
    received: None,
    asked: false,
    ending: false,
    way_on: None,
});

fn state() -> MutexGuard<'static, State> {
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says, where the program is stopped from now on, how its user goes on.
pub fn set_way_on(text: Option<String>) {
    state().way_on = text;
}

/// Asks now and then whether to stop. From the first time on, and until it is dropped, the first signal waits for an
/// answer.
#[derive(Debug, Default)]
pub struct Asked(());

impl Asked {
    /// Whether a signal has come.
    pub fn now(&self) -> bool {
        let mut state = state();
        state.asked = true;
        state.received.is_some()
    }

    /// Asks for the last time: the signal that has come, if one has. The program is to end then.
    pub fn end(self) -> Option<Signal> {
        let mut state = state();
        state.asked = false;
        state.received
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        state().asked = false;
    }
}

/// Never returns where a signal is ending the program, and work fails because what it worked on is gone. Call it before
/// reporting how the work went.
pub fn wait_if_ending() {
    while state().ending {
        std::thread::park();
    }
}

/// Waits for signals from now on. Call it once, before there is a second thread.
#[cfg(unix)]
pub fn listen() {
    unix::listen();
}

/// There are no signals here.
#[cfg(not(unix))]
pub fn listen() {}

#[cfg(unix)]
mod unix {
    use std::io::Write;
    use std::mem::MaybeUninit;
    use std::ptr;

    use super::super::children;
    use super::{Signal, state};

    const SIGNALS: [Signal; 3] = [
        Signal {
            number: libc::SIGINT,
            name: "SIGINT",
        },
        Signal {
            number: libc::SIGTERM,
            name: "SIGTERM",
        },
        Signal {
            number: libc::SIGHUP,
            name: "SIGHUP",
        },
    ];

    pub(super) fn listen() {
        // SAFETY: plain system calls; all threads are still to come and inherit the mask.
        let (set, any) = unsafe {
            let mut set = MaybeUninit::uninit();
            libc::sigemptyset(set.as_mut_ptr());
            let mut set = set.assume_init();
            let mut any = false;
            for signal in SIGNALS.iter().filter(|signal| !is_ignored(signal.number)) {
                libc::sigaddset(&mut set, signal.number);
                any = true;
            }
            libc::pthread_sigmask(libc::SIG_BLOCK, &set, ptr::null_mut());
            // A file that may not grow is an error of the file, not the end of the program.
            libc::signal(libc::SIGXFSZ, libc::SIG_IGN);
            (set, any)
        };
        if any {
            std::thread::spawn(move || {
                loop {
                    take(wait(&set));
                }
            });
        }
    }

    /// Whether the signal was turned off before the program began, as `nohup` and shells do.
    fn is_ignored(number: i32) -> bool {
        // SAFETY: the present action is only read.
        unsafe {
            let mut action = MaybeUninit::<libc::sigaction>::zeroed();
            let read = libc::sigaction(number, ptr::null(), action.as_mut_ptr());
            read == 0 && action.assume_init().sa_sigaction == libc::SIG_IGN
        }
    }

    fn wait(set: &libc::sigset_t) -> Signal {
        loop {
            let mut number = 0;
            // SAFETY: both point to what they should.
            unsafe { libc::sigwait(set, &mut number) };
            if let Some(signal) = SIGNALS.iter().find(|signal| signal.number == number) {
                return *signal;
            }
        }
    }

    /// Leaves the first signal to whoever asks, else ends the program.
    fn take(signal: Signal) {
        let mut state = state();
        let first = state.received.is_none();
        let signal = *state.received.get_or_insert(signal);
        if first && state.asked {
            drop(state);
            say(&format!(
                "{}: stopping after this step, with a checkpoint; a second signal stops at once",
                signal.name
            ));
            return;
        }
        state.ending = true;
        let way_on = state.way_on.take();
        drop(state);
        dash_model::unfinished::remove_all(children::end_all);
        let way_on = way_on.map_or(String::new(), |way_on| format!("; {way_on}"));
        say(&format!("error: stopped by {}{way_on}", signal.name));
        // SAFETY: ends the process; nothing of it is used any more.
        unsafe { libc::_exit(i32::from(signal.exit_code())) }
    }

    fn say(line: &str) {
        // Where nobody listens, as after SIGHUP, nothing can be said.
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}
