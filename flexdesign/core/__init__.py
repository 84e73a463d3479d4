"""The base of every other package: units, errors, files with units, caches, and the nouns of the domain."""
