"""What a user runs: commands, studies, pictures and reports."""
