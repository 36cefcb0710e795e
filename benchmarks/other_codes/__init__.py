"""One press and slide in space by tribox, GetFEM and CalculiX, and what each takes for it."""
