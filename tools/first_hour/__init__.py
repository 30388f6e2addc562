"""A newcomer's first hour with README and docs: ``python tools/first_hour.py``."""
