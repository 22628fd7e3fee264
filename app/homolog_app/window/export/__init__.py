"""Exports: dialogs that start ``homolog export`` in a child process and show how far it is."""
