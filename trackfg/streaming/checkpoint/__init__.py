"""The file from which a stopped stream resumes."""
