"""What the commands do, one module for each: it is imported when the command runs, so that help is shown at once."""
