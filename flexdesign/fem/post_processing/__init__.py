"""What a solution says: stress, section forces, energy, effective mass."""
