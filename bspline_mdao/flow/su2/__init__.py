"""SU2 as a flow solver: it runs in a case folder on a mesh that we write, and its adjoint on the same mesh."""
