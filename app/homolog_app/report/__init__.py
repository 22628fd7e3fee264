"""Studies of a project's result and their report; no Qt."""

__all__ = ["NOTICE"]

NOTICE = "For research use only. Not a medical device; not for diagnosis or treatment."
