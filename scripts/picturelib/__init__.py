"""Pictures of the README and the pages, made from real runs: `scripts/pictures`."""
