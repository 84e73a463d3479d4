"""Closed-form models of mechanisms: what theory says beside what finite elements and the bench say."""
