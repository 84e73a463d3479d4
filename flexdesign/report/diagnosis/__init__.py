"""Reports on measurements: comparison, identification, diagnosis, plan, static tables."""
