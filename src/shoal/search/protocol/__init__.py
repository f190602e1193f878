"""The protocol of the robots: a pure state machine, its events and its messages; no clock, no input or output."""
