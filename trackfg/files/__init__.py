"""Files and folders that are replaced in one step, and the guard of folders that trackfg owns."""
