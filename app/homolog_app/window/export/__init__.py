"""Exports: dialogs that run ``homolog export`` in a child process and show its progress."""
