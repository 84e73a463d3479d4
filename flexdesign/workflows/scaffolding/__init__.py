"""Files to start from, written once and then the user's own: a working project, a part, an effect, a study."""

from flexdesign.workflows.scaffolding.folder import write_folder
from flexdesign.workflows.scaffolding.project import write_project
from flexdesign.workflows.scaffolding.templates import write_effect, write_part, write_study

__all__ = ["write_effect", "write_folder", "write_part", "write_project", "write_study"]
