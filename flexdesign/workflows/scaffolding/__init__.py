"""Files to start from: a working project, written once and then the user's own."""

from flexdesign.workflows.scaffolding.folder import write_folder
from flexdesign.workflows.scaffolding.project import write_project

__all__ = ["write_folder", "write_project"]
