//! Compares pages and figures with the records they are made from.

mod bench;
mod bench_fixture;
mod campaign;
mod campaign_fixture;
mod changes;
mod criteria;
mod fixture;
mod flight_delay;
mod golden;
mod hostile;
mod html;
mod night_fixture;
mod no_contradiction;
mod page_text;
mod pages;
mod score;
mod sweep;
