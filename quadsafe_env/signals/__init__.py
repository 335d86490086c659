"""What is told instead of a task's own: observations and rewards as functions of documented quantities."""
