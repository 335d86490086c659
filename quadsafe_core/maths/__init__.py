"""Mathematics that knows neither vehicle nor shield: roots, least points, projections, hashes, feedback."""
