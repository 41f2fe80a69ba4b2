//! The lock of an output in a bucket: an object with the name of its owner, which the owner rewrites every minute.
//!
//! It is created only if it does not exist, and every later write replaces only the version that the writer has seen:
//! the server decides who has it. Silence of an owner is judged only by the server's clock: by the last write of the
//! lock, and that of an object written now. An owner whose process is visible from here and has ended loses it
//! immediately.

use super::{LOCK, OutputLock, Owner};
use crate::error::CampaignError;
use crate::error::StoreError;
use crate::event::Event;
use crate::run_context::RunContext;
use crate::s3::{Bucket, Object, Written};
use crate::store::bucket::{BucketStorage, Fence};
use std::io;
use std::path::Path;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// The owner rewrites its lock at this interval.
const HEARTBEAT: Duration = Duration::from_secs(60);
/// An owner that has not written it for this long counts as ended. It stops writing outputs before that (`UNSURE` of
/// the store).
const SILENCE: Duration = Duration::from_secs(8 * 60);
/// Attempts, because others may take or release it during the check.
const ATTEMPTS: usize = 5;
/// The command line is reported up to this length.
const LONGEST_COMMAND: usize = 200;

/// Takes the lock, or reports its owner.
pub(super) fn take(
    root: &Path,
    storage: &BucketStorage,
    context: &RunContext<'_>,
) -> Result<OutputLock, CampaignError> {
    let failed = |source| StoreError { path: root.join(LOCK), doing: "take the lock", source };
    let bucket = storage.objects();
    let mine = Owner { owner: described(), ..Owner::this() };
    let text = text_of(&mine);
    for _ in 0..ATTEMPTS {
        context.stopped()?;
        let sent = Instant::now();
        let mut tag = bucket.write(LOCK, &text, Written::IfAbsent).map_err(failed)?;
        if tag.is_none() {
            let Some((there, object)) = bucket.read(LOCK).map_err(failed)? else { continue };
            if let Some(busy) = at_work(&there, &object, storage, context).map_err(failed)? {
                return Err(CampaignError::Busy { out: root.to_owned(), owner: busy });
            }
            tag = bucket.write(LOCK, &text, Written::IfTagged(&object.tag)).map_err(failed)?;
        }
        if let Some(tag) = tag {
            let (fence, own) = (storage.fence(), Bucket::of_url(root).map_err(failed)?);
            fence.renew(sent);
            return Ok(OutputLock::with_heart(move |stopped| beat(&own, mine, tag, &fence, stopped)));
        }
    }
    Err(CampaignError::TryAgain(format!("{}: several runs want to write this output at the same time", root.display())))
}

/// The owner of the lock, if it is running.
fn at_work(
    text: &[u8],
    object: &Object,
    storage: &BucketStorage,
    context: &RunContext<'_>,
) -> io::Result<Option<String>> {
    let owner = serde_json::from_slice::<Owner>(text).ok();
    if owner.as_ref().is_some_and(|owner| owner.released) {
        return Ok(None);
    }
    let name = owner.as_ref().map_or("its process is unknown", |owner| owner.owner.as_str());
    let remark = |why: &str| {
        context.send(Event::Remark { text: format!("the lock of this output is taken over: {name} {why}") })
    };
    if owner.as_ref().and_then(Owner::has_ended) == Some(true) {
        remark("has ended without releasing it");
        return Ok(None);
    }
    let silent = storage.server_time()?.duration_since(object.modified).unwrap_or_default();
    if silent >= SILENCE {
        remark(&format!("was silent for {} min, by the clock of the server", silent.as_secs() / 60));
        return Ok(None);
    }
    Ok(Some(format!("{name}; it was active {} s ago", silent.as_secs())))
}

/// Rewrites the lock until it is released, or another run has taken it over.
fn beat(bucket: &Bucket, mut owner: Owner, mut tag: String, fence: &Fence, stopped: &Receiver<()>) {
    let mut stop = false;
    while !stop {
        stop = stopped.recv_timeout(HEARTBEAT) != Err(RecvTimeoutError::Timeout);
        owner.heartbeat += 1;
        owner.released = stop;
        let sent = Instant::now();
        match bucket.write(LOCK, &text_of(&owner), Written::IfTagged(&tag)) {
            Ok(Some(new)) => {
                tag = new;
                fence.renew(sent);
            }
            Ok(None) => return fence.shut(),
            // The next heartbeat may succeed. After too long without one, the store stops writing.
            Err(_) => {}
        }
    }
    fence.open();
}

fn text_of(owner: &Owner) -> Vec<u8> {
    // An owner has text keys and cannot fail.
    let mut text = serde_json::to_vec(owner).unwrap_or_default();
    text.push(b'\n');
    text
}

/// Process, host, user, start and command, for display.
fn described() -> String {
    let user = ["USER", "LOGNAME"].iter().find_map(|name| std::env::var(name).ok()).unwrap_or_else(|| "unknown".into());
    let command: Vec<String> = std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let command: String = command.join(" ").chars().take(LONGEST_COMMAND).collect();
    let at = jiff::Timestamp::now().strftime("%Y-%m-%d %H:%M:%SZ");
    format!("{} of user {user}, since {at}: {command}", Owner::this().owner)
}
