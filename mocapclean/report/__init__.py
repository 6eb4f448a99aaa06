"""Outcomes -> JSON and text. Renders, computes nothing."""
