//! Identity of the process that wrote something. A process number is not enough: hosts and containers reuse numbers.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

/// A process, distinguished from those of other hosts, containers and earlier starts of this host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Process {
    pub(crate) host: String,
    /// Boot and namespace of process numbers, 8 hexadecimal digits; `-` if the system does not report them.
    pub(crate) system: String,
    pub(crate) pid: u32,
    /// Its start time, ticks since boot.
    pub(crate) started: u64,
}

impl Process {
    /// This process.
    pub(crate) fn this() -> &'static Process {
        static THIS: OnceLock<Process> = OnceLock::new();
        THIS.get_or_init(|| {
            let pid = std::process::id();
            let started = started(Path::new("/proc/self/stat")).unwrap_or_default();
            Process { host: host_name(), system: system(), pid, started }
        })
    }

    /// Whether it has ended; `None` if it runs on another host or in another container, and so is not visible here.
    pub(crate) fn has_ended(&self) -> Option<bool> {
        let this = Process::this();
        let visible = self.system == this.system && self.system != UNKNOWN;
        visible.then(|| started(&Path::new("/proc").join(self.pid.to_string()).join("stat")) != Some(self.started))
    }
}

/// Placeholder if the system does not report its boot.
const UNKNOWN: &str = "-";

fn system() -> String {
    let boot = fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let namespace = fs::read_link("/proc/self/ns/pid").map(|link| link.to_string_lossy().into_owned());
    match namespace {
        Ok(namespace) if !boot.is_empty() => {
            let hash = blake3::hash(format!("{} {namespace}", boot.trim()).as_bytes());
            hash.to_hex().chars().take(8).collect()
        }
        _ => UNKNOWN.to_owned(),
    }
}

/// Field 22 of `/proc/PID/stat`; `None` if there is no such process, or it is a zombie. The second field is a name in
/// parentheses, which may contain anything.
fn started(stat: &Path) -> Option<u64> {
    let text = fs::read_to_string(stat).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?;
    if ["Z", "X"].contains(&state) {
        return None;
    }
    fields.nth(18)?.parse().ok()
}

/// Name of this machine, without the characters that separate the parts of a temporary name.
pub(crate) fn host_name() -> String {
    let from_kernel = fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let name = from_kernel.or_else(|| std::env::var("HOSTNAME").ok()).unwrap_or_default();
    let plain: String = name.trim().chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').take(40).collect();
    if plain.is_empty() { "host".to_owned() } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_process_is_running_and_an_ended_one_is_detected() {
        assert_eq!(Process::this().has_ended(), Some(false));
        let mut child = std::process::Command::new("true").spawn().unwrap();
        let ended = Process { pid: child.id(), started: 1, ..Process::this().clone() };
        child.wait().unwrap();
        assert_eq!(ended.has_ended(), Some(true));
        // The number was reused by a process that started at another time.
        assert_eq!(Process { started: 7, ..Process::this().clone() }.has_ended(), Some(true));
    }

    #[test]
    fn a_killed_process_has_ended_although_it_is_still_a_zombie() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let stat = Path::new("/proc").join(child.id().to_string()).join("stat");
        let process = Process { pid: child.id(), started: started(&stat).unwrap(), ..Process::this().clone() };
        assert_eq!(process.has_ended(), Some(false));
        child.kill().unwrap();
        let patience = std::time::Instant::now() + std::time::Duration::from_secs(10);
        while process.has_ended() != Some(true) && std::time::Instant::now() < patience {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        assert_eq!(process.has_ended(), Some(true));
        child.wait().unwrap();
    }

    #[test]
    fn nothing_is_known_about_a_process_of_another_host_or_container() {
        let other = Process { system: "00000000".to_owned(), ..Process::this().clone() };
        assert_eq!(other.has_ended(), None);
        assert_eq!(Process { system: UNKNOWN.to_owned(), ..Process::this().clone() }.has_ended(), None);
    }
}
