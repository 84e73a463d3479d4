"""What slender members give way, in closed form: as beams, for their width, and at their roots.

All compliances are 3 by 3, SI: the motion of a member's end relative to its start per force, as those at its centre:
along it, across it to the left, and turning to the left.
"""
