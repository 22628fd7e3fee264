"""Studies, their results and jobs, shared by the window and the command line; no Qt."""
