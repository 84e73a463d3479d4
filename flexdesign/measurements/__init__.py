"""What a bench gives: recordings, static tables, their import, their noise level."""
