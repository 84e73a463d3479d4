"""What measurements say about a model: fits that refuse to report what the data cannot determine."""

from flexdesign.estimation.fit import Fit, fit
from flexdesign.estimation.least_squares.multistart import Starts
from flexdesign.estimation.uncertainty.identifiability import Estimate

__all__ = ["Estimate", "Fit", "Starts", "fit"]
