"""The window's views, drawn on screen, or off screen for pictures and the command line; no Qt."""
