//! Records to self-contained pages and figures
