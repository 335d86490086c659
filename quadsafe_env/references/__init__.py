"""What a quadrotor is to follow: references, and scenes with obstacles on them."""
