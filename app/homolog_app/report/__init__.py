"""Studies of a project's result and the page that reports them; no Qt."""
