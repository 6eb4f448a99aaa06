"""The trust rules, one module each."""
