"""Configuration: YAML and command line to frozen settings."""
