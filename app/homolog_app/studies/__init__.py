"""Studies, their results and the work on them: what the window and the command line share; no Qt."""
