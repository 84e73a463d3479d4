"""Noise models: autoregressive processes, whitening, restricted likelihood, sinusoids."""
