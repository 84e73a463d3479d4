"""What measurements say about a model: fits that refuse to report what the data cannot determine."""

from flexdesign.evidence.fit import Fit, Match, fit
from flexdesign.evidence.identifiability import Estimate
from flexdesign.evidence.multistart import Starts
from flexdesign.evidence.noise import Noise, White, Whitening

__all__ = ["Estimate", "Fit", "Match", "Noise", "Starts", "White", "Whitening", "fit"]
