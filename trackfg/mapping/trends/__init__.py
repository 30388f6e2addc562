"""What repeated runs say of a track over time: how fast it changes, where it jumped, and when a limit is reached."""
