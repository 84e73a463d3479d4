"""Reports of designs: parts, stages, the reproduced paper."""
