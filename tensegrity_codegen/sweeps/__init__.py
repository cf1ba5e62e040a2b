"""One scene, many cases: what varies, which libraries and tasks that needs, how they run, what is kept."""
