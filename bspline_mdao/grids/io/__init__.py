"""Grid files: every format that is read or written, and patches declared beside a grid."""
