"""The fourth step: pages on the result, from an overview to modes, groups and measures."""
