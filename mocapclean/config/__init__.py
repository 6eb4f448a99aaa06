"""The configuration: its keys and defaults (``settings``), and reading it from YAML and the command (``loading``)."""
