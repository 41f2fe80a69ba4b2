//! From encoder counts to the delay and the dynamics of each channel of a sensor.
