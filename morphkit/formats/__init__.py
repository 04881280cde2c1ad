"""What XML, URDF and MJCF are: parsing, paths, names and edits of files. Nothing here knows what a limb is."""
