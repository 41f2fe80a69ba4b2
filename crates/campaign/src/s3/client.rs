//! The only module that accesses a bucket, and the only one that uses futures.
//!
//! Endpoint and credentials come from the environment: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`,
//! `AWS_ENDPOINT_URL`, `AWS_ALLOW_HTTP` and the others that `object_store` supports.

use super::SCHEME;
use crate::disk::may_heal;
use crate::file_stamp::FileStamp;
use futures_util::TryStreamExt;
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::path::Path as Key;
use object_store::{
    Attributes, ClientConfigKey, Error, GetOptions, ObjectMeta, ObjectStore, ObjectStoreExt, PutMode, PutOptions,
    RetryConfig, UpdateVersion,
};
use std::ffi::OsString;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;
use std::time::{Duration, SystemTime};
use tokio::runtime::{Builder, Runtime};

/// A request without an answer for this long is retried; the library's default of 30 s is short for a large track.
const TIMEOUT: &str = "120s";
/// No request is retried after this time. Shorter than the lock's limit for an owner that does not renew it.
const PATIENCE: Duration = Duration::from_secs(60);

/// A connection that was idle for this long is not reused: the server may have closed it.
const IDLE: &str = "10s";
/// Retries of a conditional write after a lost answer, after [`PAUSE`].
const MORE_ATTEMPTS: u32 = 2;
const PAUSE: Duration = Duration::from_secs(1);

/// A bucket and a prefix in it.
#[derive(Debug)]
pub(crate) struct Bucket {
    client: AmazonS3,
    /// `s3://bucket`.
    url: String,
    /// Without leading and trailing slashes; may be empty.
    prefix: String,
    /// Endpoint and bucket.
    place: String,
}

/// An object as the server describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Object {
    pub(crate) bytes: u64,
    pub(crate) tag: String,
    /// Modification time by the server's clock.
    pub(crate) modified: SystemTime,
}

impl Object {
    /// Identifies the content until the object is replaced.
    pub(crate) fn stamp(&self) -> FileStamp {
        FileStamp::of_object(self.bytes, &self.tag)
    }
}

/// Condition for writing an object.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Written<'a> {
    Always,
    /// The object does not exist.
    IfAbsent,
    /// The object still has this tag.
    IfTagged(&'a str),
}

/// One thread at a time drives all requests: one that waits for an answer.
fn runtime() -> io::Result<&'static Runtime> {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    if let Some(runtime) = RUNTIME.get() {
        return Ok(runtime);
    }
    let made = Builder::new_current_thread().enable_all().build()?;
    Ok(RUNTIME.get_or_init(|| made))
}

impl Bucket {
    /// Parses `s3://BUCKET/PREFIX`. Sends no request.
    pub(crate) fn of_url(path: &Path) -> io::Result<Bucket> {
        let wrong = |what: &str| io::Error::new(io::ErrorKind::InvalidInput, what.to_owned());
        let text = path.to_str().and_then(|text| text.strip_prefix(SCHEME)).ok_or_else(|| {
            wrong(
                "not an s3:// \
            address",
            )
        })?;
        let (name, prefix) = text.split_once('/').unwrap_or((text, ""));
        if name.is_empty() {
            return Err(wrong("no bucket is named: s3://BUCKET/PREFIX"));
        }
        let prefix = prefix.trim_matches('/');
        Key::parse(prefix).map_err(|e| wrong(&e.to_string()))?;
        let retry = RetryConfig { retry_timeout: PATIENCE, ..RetryConfig::default() };
        let mut builder = AmazonS3Builder::from_env().with_bucket_name(name).with_retry(retry);
        let usual = [
            ("AWS_TIMEOUT", ClientConfigKey::Timeout, TIMEOUT),
            ("AWS_POOL_IDLE_TIMEOUT", ClientConfigKey::PoolIdleTimeout, IDLE),
        ];
        for (_, key, value) in usual.into_iter().filter(|(name, ..)| std::env::var_os(name).is_none()) {
            builder = builder.with_config(AmazonS3ConfigKey::Client(key), value);
        }
        let endpoint = [AmazonS3ConfigKey::S3Endpoint, AmazonS3ConfigKey::Endpoint];
        let endpoint = endpoint.iter().find_map(|key| builder.get_config_value(key)).unwrap_or_default();
        let client = builder.build().map_err(|e| wrong(&reason(&e)))?;
        let place = format!("{endpoint} {name}");
        Ok(Bucket { client, url: format!("{SCHEME}{name}"), prefix: prefix.to_owned(), place })
    }

    /// The address of an object, for display.
    pub(crate) fn url_of(&self, name: &str) -> String {
        format!("{}/{}", self.url, self.full(name))
    }

    /// Endpoint and bucket: objects of two servers may have the same name.
    pub(crate) fn place(&self) -> &str {
        &self.place
    }

    fn full(&self, name: &str) -> String {
        match (self.prefix.as_str(), name) {
            ("", name) => name.to_owned(),
            (prefix, "") => prefix.to_owned(),
            (prefix, name) => format!("{prefix}/{name}"),
        }
    }

    fn key(&self, name: &str) -> io::Result<Key> {
        Key::parse(self.full(name)).map_err(|e| io::Error::new(io::ErrorKind::InvalidInput, e.to_string()))
    }

    /// Content and metadata of an object; `None` if it does not exist.
    pub(crate) fn read(&self, name: &str) -> io::Result<Option<(Vec<u8>, Object)>> {
        let key = self.key(name)?;
        let work = async {
            let answer = self.client.get(&key).await?;
            let object = described(&answer.meta);
            Ok((answer.bytes().await?.to_vec(), object))
        };
        found(runtime()?.block_on(work)).and_then(|found| found.map(|(bytes, object)| Ok((bytes, object?))).transpose())
    }

    /// A byte range of the object with this tag.
    pub(crate) fn read_piece(&self, name: &str, tag: &str, piece: Range<u64>) -> io::Result<Vec<u8>> {
        let key = self.key(name)?;
        let options = GetOptions { if_match: Some(tag.to_owned()), range: Some(piece.into()), ..GetOptions::default() };
        let work = async { self.client.get_opts(&key, options).await?.bytes().await };
        match runtime()?.block_on(work) {
            Ok(bytes) => Ok(bytes.to_vec()),
            Err(Error::Precondition { .. }) => {
                Err(io::Error::new(io::ErrorKind::InvalidData, "the object was replaced while it was read"))
            }
            Err(error) => Err(io_error(&error)),
        }
    }

    /// Metadata of an object from the server; `None` if it does not exist.
    pub(crate) fn describe(&self, name: &str) -> io::Result<Option<Object>> {
        let key = self.key(name)?;
        found(runtime()?.block_on(self.client.head(&key)))?.map(|meta| described(&meta)).transpose()
    }

    /// Writes an object atomically. Returns its tag, or `None` if the condition is not met.
    pub(crate) fn write(&self, name: &str, bytes: &[u8], when: Written<'_>) -> io::Result<Option<String>> {
        let key = self.key(name)?;
        let mode = match when {
            Written::Always => PutMode::Overwrite,
            Written::IfAbsent => PutMode::Create,
            Written::IfTagged(tag) => PutMode::Update(UpdateVersion { e_tag: Some(tag.to_owned()), version: None }),
        };
        let options = PutOptions { mode, attributes: Attributes::new(), ..PutOptions::default() };
        let mut left = if matches!(when, Written::Always) { 0 } else { MORE_ATTEMPTS };
        loop {
            let work = self.client.put_opts(&key, bytes.to_vec().into(), options.clone());
            match runtime()?.block_on(work).map_err(|error| (io_error(&error), error)) {
                Ok(answer) => return answer.e_tag.map(Some).ok_or_else(no_tag),
                Err((_, Error::AlreadyExists { .. } | Error::Precondition { .. })) => return self.own(name, bytes),
                // The library sends a conditional write only once, because it cannot find out whether an existing object is
                // its own.
                Err((error, _)) if left > 0 && may_heal(&error) => std::thread::sleep(PAUSE),
                Err((error, _)) => return Err(error),
            }
            left -= 1;
        }
    }

    /// The tag of an object that a lost first attempt already wrote with these bytes.
    fn own(&self, name: &str, bytes: &[u8]) -> io::Result<Option<String>> {
        Ok(self.read(name)?.filter(|(there, _)| there == bytes).map(|(_, object)| object.tag))
    }

    /// Removes an object, if it exists.
    pub(crate) fn remove(&self, name: &str) -> io::Result<()> {
        let key = self.key(name)?;
        found(runtime()?.block_on(self.client.delete(&key))).map(drop)
    }

    /// Names of the objects and folders directly below the prefix.
    pub(crate) fn first_names(&self) -> io::Result<Vec<OsString>> {
        let key = self.key("")?;
        let below = Some(&key).filter(|key| !key.as_ref().is_empty());
        let found = runtime()?.block_on(self.client.list_with_delimiter(below)).map_err(|error| io_error(&error))?;
        let all = found.objects.iter().map(|meta| &meta.location).chain(&found.common_prefixes);
        Ok(all.filter_map(|key| Some(key.filename()?.into())).collect())
    }

    /// All objects below a folder, by name below this bucket's prefix.
    pub(crate) fn list(&self, folder: &str) -> io::Result<Vec<(String, Object)>> {
        let key = self.key(folder)?;
        let below = Some(&key).filter(|key| !key.as_ref().is_empty());
        let found: Vec<ObjectMeta> = match runtime()?.block_on(self.client.list(below).try_collect()) {
            Ok(found) => found,
            Err(error) => return Err(io_error(&error)),
        };
        let strip = |key: &Key| match self.prefix.as_str() {
            "" => Some(key.as_ref().to_owned()),
            prefix => key.as_ref().strip_prefix(prefix)?.strip_prefix('/').map(str::to_owned),
        };
        let named = found.iter().filter_map(|meta| Some((strip(&meta.location)?, meta)));
        named.map(|(name, meta)| Ok((name, described(meta)?))).collect()
    }
}

/// Content of one object by its address; `None` if it does not exist.
pub(crate) fn read_url(path: &Path) -> io::Result<Option<Vec<u8>>> {
    Ok(Bucket::of_url(path)?.read("")?.map(|(bytes, _)| bytes))
}

fn described(meta: &ObjectMeta) -> io::Result<Object> {
    let tag = meta.e_tag.clone().ok_or_else(no_tag)?;
    Ok(Object { bytes: meta.size, tag, modified: meta.last_modified.into() })
}

fn no_tag() -> io::Error {
    let what = "the server sends no ETag with objects, so a changed object would not be noticed";
    io::Error::new(io::ErrorKind::Unsupported, what)
}

fn found<T>(answer: Result<T, Error>) -> io::Result<Option<T>> {
    match answer {
        Ok(found) => Ok(Some(found)),
        // A missing bucket is an error, unlike a missing object.
        Err(error @ Error::NotFound { .. }) if reason(&error).contains("NoSuchBucket") => Err(io_error(&error)),
        Err(Error::NotFound { .. }) => Ok(None),
        Err(error) => Err(io_error(&error)),
    }
}

/// Converts an error of the library to a system error, so that [`may_heal`] recognises temporary ones.
fn io_error(error: &Error) -> io::Error {
    let text = reason(error);
    let (kind, advice) = match error {
        Error::NotFound { .. } => (io::ErrorKind::NotFound, ""),
        Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => {
            (io::ErrorKind::PermissionDenied, "; use other keys or another policy: trying again will not help")
        }
        Error::Generic { .. } if !is_refusal(&text) => (io::ErrorKind::TimedOut, "; try again later"),
        _ => (io::ErrorKind::Other, ""),
    };
    io::Error::new(kind, format!("{text}{advice}"))
}

/// Whether the server rejected the request permanently: codes 300 to 499, except those for "too many" and "too slow".
fn is_refusal(text: &str) -> bool {
    let code = text.split_once("status code: ").and_then(|(_, rest)| rest.get(..3)?.parse::<u16>().ok());
    code.is_some_and(|code| (300..500).contains(&code) && ![408, 425, 429].contains(&code))
        || text.contains("BareRedirect")
        || text.contains("without LOCATION")
}

/// The innermost reasons, on one line.
fn reason(error: &Error) -> String {
    let mut chain: Vec<String> = vec![];
    let mut next: Option<&(dyn std::error::Error + 'static)> = Some(error);
    while let Some(error) = next {
        chain.push(error.to_string());
        next = error.source();
    }
    let mut innermost: Vec<&str> = vec![];
    // An outer error usually repeats the inner one.
    for (i, text) in chain.iter().enumerate() {
        let is_repeated = chain.get(i + 1).is_some_and(|inner| text.contains(inner.as_str()));
        if !is_repeated || i + 1 == chain.len() {
            innermost.push(text);
        }
    }
    innermost.join(": ").split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generic(text: &str) -> Error {
        Error::Generic { store: "S3", source: text.into() }
    }

    #[test]
    fn temporary_errors_are_distinguished_from_permanent_ones() {
        let heals = |error: &Error| may_heal(&io_error(error));
        assert!(heals(&generic("Server returned non-2xx status code: 503 Service Unavailable: SlowDown")));
        assert!(heals(&generic("Server returned non-2xx status code: 429 Too Many Requests")));
        assert!(heals(&generic("HTTP error: error sending request: connection refused")));
        assert!(!heals(&generic("Server returned non-2xx status code: 400 Bad Request: InvalidBucketName")));
        assert!(!heals(&Error::PermissionDenied { path: "a".into(), source: "403".into() }));
        assert!(!heals(&Error::NotFound { path: "a".into(), source: "NoSuchBucket".into() }));
        assert!(found::<()>(Err(Error::NotFound { path: "a".into(), source: "NoSuchKey".into() })).unwrap().is_none());
        assert!(found::<()>(Err(Error::NotFound { path: "a".into(), source: "NoSuchBucket".into() })).is_err());
    }

    #[test]
    fn an_address_must_name_a_bucket_and_a_prefix() {
        let bucket = Bucket::of_url(Path::new("s3://lab/flights/may/")).unwrap();
        assert_eq!(bucket.url_of("a.bin"), "s3://lab/flights/may/a.bin");
        assert_eq!(Bucket::of_url(Path::new("s3://lab")).unwrap().url_of("a/b"), "s3://lab/a/b");
        for wrong in ["s3://", "s3:///x", "s3://lab/a/../b", "/tmp/x"] {
            assert!(Bucket::of_url(Path::new(wrong)).is_err(), "{wrong}");
        }
    }
}
