"""What did a run find? Its folder and verdict, the stages that make it, its pages, and studies of several runs."""
