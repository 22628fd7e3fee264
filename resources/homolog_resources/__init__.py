"""Icons, style sheets, colour tables and other files that the application shows."""
