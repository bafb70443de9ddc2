"""What `bench new` makes: a repository of a user's own, for an estimator, a task or a source.

Lives here: the files that it is made from, each with `.txt` behind its name, and what fills them in. In them the new
name is `your-name`, `your_name` and `YourName`, so that they are files as they will be. Does not live here:
anything that the made repository calls; that is `tactsim` as any package sees it.
"""
