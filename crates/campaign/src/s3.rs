//! Bucket addresses, `s3://BUCKET/PREFIX`, and with the feature `s3` access to buckets.

#[cfg(feature = "s3")]
mod client;

#[cfg(feature = "s3")]
pub(crate) use client::{Bucket, Object, Written, read_url};

use std::path::Path;

const SCHEME: &str = "s3://";

/// Whether a path is a bucket address, `s3://BUCKET/PREFIX`, and not a folder.
#[must_use]
pub fn is_in_bucket(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.starts_with(SCHEME))
}

/// The error for a bucket in a build without S3 support.
#[cfg(not(feature = "s3"))]
pub(crate) fn not_built() -> std::io::Error {
    let what = "flightlag was built without support for buckets; build it with `--features s3`";
    std::io::Error::new(std::io::ErrorKind::InvalidInput, what)
}
