"""The trust rules, one module each; ``mocapclean.detection`` describes what such a module has."""
