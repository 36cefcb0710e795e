/* Counts what each rank sends: a library that stands before MPI.
 *
 *   mpicc -O2 -shared -fPIC -o count_messages.so benchmarks/count_messages.c
 *   LD_PRELOAD=$PWD/count_messages.so ./tribox run CASE --np 4
 *
 * At its end each rank prints the messages that it has sent to single others, persistent ones and
 * those to neighbours included, their bytes, and the operations over all ranks.
 */

#include <mpi.h>
#include <stdio.h>

enum { MOST = 4096 };
static long messages, bytes, collectives;
static MPI_Request known[MOST]; /* persistent sends, and their bytes */
static long sizes[MOST];
static int used;

static void sent(long count, MPI_Datatype type)
{
    int size;
    PMPI_Type_size(type, &size);
    ++messages;
    bytes += count * size;
}

#define ARGUMENTS const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c
#define SEND(name)                                                                                 \
    int MPI_##name(ARGUMENTS)                                                                      \
    {                                                                                              \
        sent(n, t);                                                                                \
        return PMPI_##name(b, n, t, to, tag, c);                                                   \
    }
#define START(name)                                                                                \
    int MPI_##name(ARGUMENTS, MPI_Request *r)                                                      \
    {                                                                                              \
        sent(n, t);                                                                                \
        return PMPI_##name(b, n, t, to, tag, c, r);                                                \
    }
SEND(Send)
SEND(Ssend)
START(Isend)
START(Issend)

int MPI_Send_init(ARGUMENTS, MPI_Request *r)
{
    int size, code = PMPI_Send_init(b, n, t, to, tag, c, r);
    PMPI_Type_size(t, &size);
    known[used % MOST] = *r;
    sizes[used++ % MOST] = (long)n * size;
    return code;
}

static void started(MPI_Request request)
{
    const int all = used < MOST ? used : MOST;
    for (int k = 1; k <= all; ++k) { /* the latest first: handles are used again */
        const int at = (used - k + MOST) % MOST;
        if (known[at] == request) {
            ++messages;
            bytes += sizes[at];
            return;
        }
    }
}

int MPI_Start(MPI_Request *r)
{
    started(*r);
    return PMPI_Start(r);
}

int MPI_Startall(int n, MPI_Request r[])
{
    for (int k = 0; k < n; ++k)
        started(r[k]);
    return PMPI_Startall(n, r);
}

static void to_neighbours(const int counts[], int each, MPI_Datatype t, MPI_Comm c)
{
    int in, out, weighted;
    PMPI_Dist_graph_neighbors_count(c, &in, &out, &weighted);
    for (int k = 0; k < out; ++k)
        if (counts ? counts[k] : each)
            sent(counts ? counts[k] : each, t);
}

#define TO_NEIGHBOURS                                                                              \
    const void *s, const int *sn, const int *sd, MPI_Datatype st, void *r, const int *rn,          \
        const int *rd, MPI_Datatype rt, MPI_Comm c

int MPI_Neighbor_alltoallv(TO_NEIGHBOURS)
{
    to_neighbours(sn, 0, st, c);
    return PMPI_Neighbor_alltoallv(s, sn, sd, st, r, rn, rd, rt, c);
}

int MPI_Ineighbor_alltoallv(TO_NEIGHBOURS, MPI_Request *q)
{
    to_neighbours(sn, 0, st, c);
    return PMPI_Ineighbor_alltoallv(s, sn, sd, st, r, rn, rd, rt, c, q);
}

int MPI_Neighbor_alltoall(const void *s, int sn, MPI_Datatype st, void *r, int rn, MPI_Datatype rt,
                          MPI_Comm c)
{
    to_neighbours(0, sn, st, c);
    return PMPI_Neighbor_alltoall(s, sn, st, r, rn, rt, c);
}

int MPI_Allreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op op, MPI_Comm c)
{
    int ranks;
    PMPI_Comm_size(c, &ranks);
    collectives += ranks > 1;
    return PMPI_Allreduce(s, r, n, t, op, c);
}

int MPI_Finalize(void)
{
    int rank;
    PMPI_Comm_rank(MPI_COMM_WORLD, &rank);
    fprintf(stderr, "rank %d sent %ld messages, %ld bytes, took part in %ld sums\n", rank, messages,
            bytes, collectives);
    return PMPI_Finalize();
}
