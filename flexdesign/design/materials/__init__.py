"""Materials: elastic constants, strengths and fatigue data, each number with its source.

The library is a data file, ``library.toml``; a design may also name a file of its own or hold a table.
"""

from flexdesign.design.materials.crystal import Crystal as Crystal
from flexdesign.design.materials.fatigue import Fatigue as Fatigue
from flexdesign.design.materials.library import find as find
from flexdesign.design.materials.library import library as library
from flexdesign.design.materials.library import read as read
from flexdesign.design.materials.material import Material as Material
