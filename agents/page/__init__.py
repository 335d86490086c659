"""What a page is made of: HTML, colours, meshes of bodies."""
