"""What the views of the window show, drawn on a screen, or aside for pictures and the command line; no Qt."""
