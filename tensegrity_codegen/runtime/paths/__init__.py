"""Load paths: continuation of equilibria through limit points and bifurcations."""
