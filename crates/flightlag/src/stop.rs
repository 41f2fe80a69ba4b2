//! Ctrl-C and the like: stop cleanly, and within a second in any case.

use campaign::Exit;
#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
#[cfg(unix)]
use std::sync::atomic::{AtomicI32, Ordering};
#[cfg(unix)]
use std::time::Duration;

/// How long flights in work get to stop by themselves. Results are written whole or not at all,
/// so that leaving earlier than that loses work and nothing else. A person who presses Ctrl-C waits for it; a machine that
/// sends SIGTERM gives more time, in which a reduction writes down how far it is.
#[cfg(unix)]
fn patience(signal: i32) -> Duration {
    Duration::from_millis(if signal == SIGINT { 700 } else { 5000 })
}

#[cfg(unix)]
static LAST_SIGNAL: AtomicI32 = AtomicI32::new(0);

/// Set when the user wants to stop.
pub(crate) struct Stop {
    flag: Arc<AtomicBool>,
}

impl Stop {
    /// Begins to listen for signals.
    #[cfg(unix)]
    pub(crate) fn listen() -> io::Result<Stop> {
        let flag = Arc::new(AtomicBool::new(false));
        let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        // A file size limit shall be an error of the write, not the end of the process.
        signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?;
        let raised = Arc::clone(&flag);
        std::thread::spawn(move || {
            for signal in signals.forever() {
                LAST_SIGNAL.store(signal, Ordering::SeqCst);
                if raised.swap(true, Ordering::SeqCst) {
                    leave();
                }
                std::thread::spawn(move || {
                    std::thread::sleep(patience(signal));
                    leave();
                });
            }
        });
        Ok(Stop { flag })
    }

    /// Begins to listen for Ctrl-C, the second of which ends the process.
    #[cfg(not(unix))]
    pub(crate) fn listen() -> io::Result<Stop> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register_conditional_shutdown(signal, Exit::Stopped as i32, Arc::clone(&flag))?;
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
        }
        Ok(Stop { flag })
    }

    /// The flag that workers look at.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.flag
    }
}

#[cfg(unix)]
fn leave() -> ! {
    std::process::exit(exit_of_last_signal() as i32)
}

/// Ctrl-C is the user's; the other signals come from a machine that may start us again.
#[cfg(unix)]
pub(crate) fn exit_of_last_signal() -> Exit {
    match LAST_SIGNAL.load(Ordering::SeqCst) {
        SIGTERM | SIGHUP => Exit::TryAgain,
        _ => Exit::Stopped,
    }
}

/// Only Ctrl-C is heard here.
#[cfg(not(unix))]
pub(crate) fn exit_of_last_signal() -> Exit {
    Exit::Stopped
}
