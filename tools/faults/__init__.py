"""Faults put into everything that trackfg reads, and into what it runs on: does each end as documented?"""
