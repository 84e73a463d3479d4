"""From a solid to elements: domain, thickness gate, extruded, planar and free meshes."""
