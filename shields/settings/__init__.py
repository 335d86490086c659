"""What a shield is told: settings, declared errors, and what a plant says of itself."""
