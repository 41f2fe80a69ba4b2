//! Integration tests of the bench.

mod alignment;
mod clocks;
mod dynamics;
mod encoder;
mod golden;
mod honesty;
mod iron;
mod kinematics;
mod magnetic;
mod magnetometer;
mod mount;
mod references;
mod rig;
mod support;
