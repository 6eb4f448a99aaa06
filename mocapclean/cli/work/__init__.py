"""The work of the commands, one module each: it is imported when the command runs, so that help is shown at once."""
