"""The pipeline as a state machine; the command line and the window drive the same one."""
