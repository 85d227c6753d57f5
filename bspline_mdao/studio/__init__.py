"""What users run: commands, studies, pictures and reports."""
