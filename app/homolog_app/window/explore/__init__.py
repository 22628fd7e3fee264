"""The fourth step: pages that look at the result, from an overview to modes, groups and measures."""
