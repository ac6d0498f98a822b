"""What the paper does not show: coverage, mistakes, degenerate motions, coaching."""
