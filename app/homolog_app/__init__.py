"""The application: command line, pictures, reports and the desktop window."""
