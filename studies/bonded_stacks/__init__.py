"""The amplified actuator APA300ML as shell and stacks bonded, compared with its published matrices.

`flexdesign published apa300ml` compares the statics of the shell, with the stacks as a spring. A spring has no mass and
holds nothing sideways. Here the stacks are solids, in a mesh of quadratic tetrahedra that shares no code with the
package: meshed by Netgen, assembled by scikit-fem.
"""
