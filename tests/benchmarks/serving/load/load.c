/* Clients of a server, in one process and without an interpreter: load PORT CLIENTS SECONDS PERIOD_US PER_PEER ANSWER REQUEST...

   Each client asks, waits for the whole answer and asks again: at once (PERIOD_US 0), or each PERIOD_US after it asked.
   ANSWER: bytes of it, 0: until LF. REQUEST: bytes in hex, every client has its own turn of them. PER_PEER clients come from
   one loopback address. Prints: answers a second, and median, 99th percentile and largest of the answer's time, us. */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

enum { MOST_CLIENTS = 1024, MOST_BYTES = 1024, BIN_NS = 1000, BINS = 1000000 };

struct client { int fd, got; long asked_ns, due_ns; char waits; };

static struct client clients[MOST_CLIENTS];
static unsigned char requests[MOST_CLIENTS][MOST_BYTES];
static int lengths[MOST_CLIENTS], kinds;
static unsigned bins[BINS + 1];

static long now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1000000000L * t.tv_sec + t.tv_nsec;
}

static void fail(const char *what) { perror(what); exit(1); }

static void ask(struct client *c, int kind) {
    c->asked_ns = now_ns();
    c->got = 0;
    c->waits = 1;
    if (send(c->fd, requests[kind], lengths[kind], MSG_NOSIGNAL) != lengths[kind]) fail("send");
}

static void join(struct client *c, int port, int peer) {
    struct sockaddr_in here = {.sin_family = AF_INET}, there = here;
    int one = 1;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK + peer);
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    there.sin_port = htons(port);
    c->fd = socket(AF_INET, SOCK_STREAM, 0);
    if (bind(c->fd, (void *)&here, sizeof here) || connect(c->fd, (void *)&there, sizeof there)) fail("connect");
    setsockopt(c->fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
}

static int is_whole(struct client *c, long answer) {
    char bytes[MOST_BYTES];
    long n = recv(c->fd, bytes, sizeof bytes, 0);
    if (n <= 0) fail("recv");
    c->got += n;
    return answer ? c->got >= answer : bytes[n - 1] == '\n';
}

static double quantile(unsigned long count, double share) {
    unsigned long sum = 0, want = share * count;
    for (int i = 0; i <= BINS; i++)
        if ((sum += bins[i]) > want) return (i + 0.5) * BIN_NS / 1000.0;
    return 0;
}

int main(int argc, char **argv) {
    if (argc < 8) { fprintf(stderr, "usage: load PORT CLIENTS SECONDS PERIOD_US PER_PEER ANSWER REQUEST...\n"); return 2; }
    int port = atoi(argv[1]), count = atoi(argv[2]), per_peer = atoi(argv[5]);
    long period_ns = 1000L * atol(argv[4]), answer = atol(argv[6]);
    for (kinds = 0; kinds < argc - 7; kinds++)
        for (const char *hex = argv[7 + kinds]; sscanf(hex, "%2hhx", &requests[kinds][lengths[kinds]]) == 1; hex += 2) lengths[kinds]++;
    int poll = epoll_create1(0), clock_fd = timerfd_create(CLOCK_MONOTONIC, 0);
    struct epoll_event event = {.events = EPOLLIN, .data.ptr = NULL}, events[64];
    epoll_ctl(poll, EPOLL_CTL_ADD, clock_fd, &event);
    for (int i = 0; i < count; i++) {
        join(&clients[i], port, i / per_peer);
        event.data.ptr = &clients[i];
        epoll_ctl(poll, EPOLL_CTL_ADD, clients[i].fd, &event);
    }
    long begin = now_ns(), end = begin + (long)(1e9 * atof(argv[3])), next = begin, now;
    unsigned long answers = 0;
    double largest = 0;
    for (int i = 0; i < count; i++) {
        clients[i].due_ns = begin + period_ns * i / count;
        if (!period_ns) ask(&clients[i], i % kinds);
    }
    struct itimerspec tick = {{0, period_ns / count}, {0, 1}};
    if (period_ns) timerfd_settime(clock_fd, 0, &tick, NULL);
    while ((now = now_ns()) < end) {
        int n = epoll_wait(poll, events, 64, 100);
        for (int e = 0; e < n; e++) {
            struct client *c = events[e].data.ptr;
            if (!c) { unsigned long ticks; if (read(clock_fd, &ticks, sizeof ticks) < 0) fail("timer"); next = 0; continue; }
            if (!is_whole(c, answer)) continue;
            long took = now_ns() - c->asked_ns;
            c->waits = 0;
            answers++;
            bins[took / BIN_NS < BINS ? took / BIN_NS : BINS]++;
            if (took > largest) largest = took;
            if (!period_ns) ask(c, (c - clients) % kinds);
        }
        if (period_ns && next == 0) {
            now = now_ns();
            for (int i = 0; i < count; i++)
                if (!clients[i].waits && clients[i].due_ns <= now) {
                    while (clients[i].due_ns <= now) clients[i].due_ns += period_ns;
                    ask(&clients[i], i % kinds);
                }
        }
    }
    printf("%.1f %.1f %.1f %.1f\n", answers / ((now_ns() - begin) / 1e9), quantile(answers, 0.5), quantile(answers, 0.99), largest / 1000);
    return 0;
}
