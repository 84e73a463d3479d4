"""Which effects a model needs: score test, stepwise selection, comparison of models."""
