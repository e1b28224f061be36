"""Trials that look for sets without the truth."""
