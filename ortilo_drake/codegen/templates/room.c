/* Room for arrays that functions make within a call: blocks one after the other. The newest go first; one that is given
   back before a newer one stays until that is given back. Nothing outlives a call. */
typedef struct { /* 32 bytes on every processor */
    int64_t holders, before, size;
    void *data;
} block;

void *ortilo_take(void *room, int64_t size);
void ortilo_give(void *room, void *given);

static block *block_at(ortilo_room *room, int64_t at) { return (block *)(void *)((char *)room->bytes + at); }

void *ortilo_take(void *room, int64_t size) {
    ortilo_room *const r = room;
    const int64_t left = (int64_t)sizeof r->bytes - r->top - (int64_t)sizeof(block);
    if (size < 0 || size > left - 7) return NULL;
    block *const made = block_at(r, r->top);
    *made = (block){1, r->last, size, made + 1};
    r->last = r->top;
    r->top += (int64_t)sizeof(block) + (size + 7) / 8 * 8;
    if (r->top > r->most) r->most = r->top;
    return made;
}

void ortilo_give(void *room, void *given) {
    ortilo_room *const r = room;
    ((block *)given)->holders = 0;
    while (r->last >= 0 && block_at(r, r->last)->holders == 0) {
        r->top = r->last;
        r->last = block_at(r, r->last)->before;
    }
}

static void *room_of(ortilo *self) {
    self->room.top = 0, self->room.last = -1;
    return &self->room;
}
