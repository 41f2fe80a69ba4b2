//! Ctrl-C and similar signals: stop cleanly, and within a second in any case.

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

/// Time for running flights to stop by themselves. Results are written atomically, so leaving
/// earlier loses only unfinished work. A person who presses Ctrl-C is waiting; a machine that
/// sends SIGTERM gives more time, in which a reduction saves its progress.
#[cfg(unix)]
fn patience(signal: i32) -> Duration {
    Duration::from_millis(if signal == SIGINT { 700 } else { 5000 })
}

#[cfg(unix)]
static LAST_SIGNAL: AtomicI32 = AtomicI32::new(0);

/// Set when the user requests a stop.
pub(crate) struct Stop {
    flag: Arc<AtomicBool>,
}

impl Stop {
    /// Starts listening for signals.
    #[cfg(unix)]
    pub(crate) fn listen() -> io::Result<Stop> {
        let flag = Arc::new(AtomicBool::new(false));
        let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM, SIGHUP])?;
        // Exceeding a file size limit must be a write error, not the end of the process.
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

    /// Starts listening for Ctrl-C; the second one ends the process.
    #[cfg(not(unix))]
    pub(crate) fn listen() -> io::Result<Stop> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register_conditional_shutdown(signal, Exit::Stopped as i32, Arc::clone(&flag))?;
            signal_hook::flag::register(signal, Arc::clone(&flag))?;
        }
        Ok(Stop { flag })
    }

    /// The flag that workers check.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.flag
    }
}

#[cfg(unix)]
fn leave() -> ! {
    std::process::exit(exit_of_last_signal() as i32)
}

/// Ctrl-C comes from the user; other signals come from a machine that may restart us.
#[cfg(unix)]
pub(crate) fn exit_of_last_signal() -> Exit {
    match LAST_SIGNAL.load(Ordering::SeqCst) {
        SIGTERM | SIGHUP => Exit::TryAgain,
        _ => Exit::Stopped,
    }
}

/// Only Ctrl-C is handled here.
#[cfg(not(unix))]
pub(crate) fn exit_of_last_signal() -> Exit {
    Exit::Stopped
}
