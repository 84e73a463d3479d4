"""One axis of a stage model as an estimation problem: parameters, response, recorded runs."""
