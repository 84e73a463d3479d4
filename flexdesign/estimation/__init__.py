"""What measurements say about a model: fits that refuse to report what the data cannot determine."""

from flexdesign.estimation.fit import Fit, Match, fit
from flexdesign.estimation.least_squares.multistart import Starts
from flexdesign.estimation.noise.whitening import Noise, White, Whitening
from flexdesign.estimation.uncertainty.identifiability import Estimate

__all__ = ["Estimate", "Fit", "Match", "Noise", "Starts", "White", "Whitening", "fit"]
