"""Grid files: all formats that are read or written, and patches declared in files of their own."""
