# tribox on Debian 13: every dependency is a Debian package.
#
#   docker build -t tribox .
#   mkdir -p results
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/results:/results" tribox run cases/sfa.toml
#
# Any Debian 13 root serves as BASE; where none can be pulled, ./tribox makes one (docs/install.md).
ARG BASE=debian:trixie-slim
FROM ${BASE}

# Lines for apt.conf (a proxy, say) and a Debian mirror to use instead of the base's own.
ARG APT_OPTIONS=""
ARG APT_MIRROR=""

# Dependencies first: editing a source never downloads anything. FFCx compiles forms at run time, so
# gcc stays. dpkg need not sync every file of an image to disk, nor unpack what nobody reads there.
RUN set -eu; \
    printf '%s\n' "$APT_OPTIONS" > /etc/apt/apt.conf.d/99build; \
    if [ -n "$APT_MIRROR" ]; then \
        find /etc/apt/sources.list /etc/apt/sources.list.d -type f -exec \
            sed -i -E "s#https?://[^ ]*/debian/?( |\$)#$APT_MIRROR\1#" {} +; \
    fi; \
    printf '%s\n' force-unsafe-io 'path-exclude=/usr/share/doc/*' 'path-exclude=/usr/share/man/*' \
        'path-exclude=/usr/share/locale/*' > /etc/dpkg/dpkg.cfg.d/lean; \
    apt-get update; \
    DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        gcc libc6-dev libmetis5 tini \
        python3-dolfinx-real python3-petsc4py-real python3-gmsh python3-meshio \
        python3-scipy python3-pandas python3-matplotlib python3-pydantic python3-pint python3-rich \
        python3-typer python3-jinja2 python3-pyvista libopenblas0-serial python3-hypothesis \
        python3-mypy python3-pytest python3-pytest-timeout python3-pytest-xdist \
        python3-sphinx furo python3-myst-parser python3-sphinx-copybutton libjs-katex \
        python3-nbclient python3-nbformat python3-ipykernel; \
    apt-get clean; \
    rm -rf /var/lib/apt/lists/* /etc/apt/apt.conf.d/99build

# Open MPI: usable by root, shared memory only, more ranks than cores allowed, no pinning to cores
# that may not be ours; topo=basic avoids a hang of MPI_Dist_graph_create in Open MPI 5.0.7.
# One thread per rank: threads and ranks would fight for the cores.
ENV OMPI_ALLOW_RUN_AS_ROOT=1 \
    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
    OMPI_MCA_btl=self,sm \
    OMPI_MCA_topo=basic \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe \
    PRTE_MCA_hwloc_default_binding_policy=none \
    OMP_NUM_THREADS=1 \
    MPLBACKEND=Agg \
    LANG=C.UTF-8

# Home and caches that any user id may write to, with or without an entry in /etc/passwd (where the
# root file system is read-only, docker/entry makes others). /root may hold a working directory.
ENV HOME=/var/cache/tribox/home \
    XDG_CACHE_HOME=/var/cache/tribox \
    MPLCONFIGDIR=/var/cache/tribox/matplotlib \
    HYPOTHESIS_STORAGE_DIRECTORY=/tmp/hypothesis
RUN chmod 755 /root && mkdir -p -m 1777 /results /var/cache/tribox && cd /var/cache/tribox \
    && mkdir -m 1777 fenics home matplotlib \
    && python3 -c "import matplotlib.font_manager" && chmod -R a+rX .

# The program: `tribox`, and an `mpirun` that writes as the owner of /results too. Drawings, which are
# scripts of gmsh, reach no further in here than the program itself: they need no trust.
ENV PYTHONPATH=/tribox/src TRIBOX_RESULTS=/results TRIBOX_CONTAINED=1
COPY docker/entry /usr/local/bin/tribox
RUN cd /usr/local/bin && chmod 755 tribox && ln -s tribox mpirun && ln -s tribox mpiexec
WORKDIR /tribox

# Compile all forms into FFCx's cache. Only what they are made from goes in before: ./tribox names the
# image by these files and the ones copied above.
COPY src src
COPY forms forms
COPY geometry geometry
COPY app/__init__.py app/errors.py app/precompile.py app/
COPY app/equilibrium app/equilibrium
COPY app/results/__init__.py app/results/fields.py app/results/
RUN python3 -B -m tribox.app.precompile && chmod -R a+rX /var/cache/tribox/fenics && rm -rf /tmp/*

COPY . .
RUN python3 -m compileall -q app forms geometry
ENTRYPOINT ["tini", "--", "tribox"]
